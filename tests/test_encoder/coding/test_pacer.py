"""The pacer: layer packets and frame packets together keep to the rate."""

from itertools import accumulate

from hypothesis import given
from hypothesis import strategies as st
from packets import MODEL, sent_bytes

from encoder.coding.pacer import LayerPacer
from encoder.coding.progressive_model import LayeredModel
from protocol.packets import LayerPacket, serialise
from protocol.progressive_model import stream_item


@given(
    st.lists(st.binary(max_size=900), min_size=2, max_size=9),
    st.floats(2000, 50_000),
    st.lists(st.integers(3, 60), min_size=40, max_size=40),
)
def test_layers_and_frames_keep_to_the_rate(
    items: list[bytes], bitrate: float, frames: list[int]
) -> None:
    pacer, slot_s, sent_bits = LayerPacer(bitrate), 8 / 30, 0
    pacer.start(LayeredModel(MODEL, tuple(items)))
    stream = b""
    for slots, size in enumerate(frames, start=1):
        pacer.on_packet_sent(size)
        sent_bits += 8 * (size + 1)
        for layer in pacer.packets_due(slot_s):
            sent_bits += 8 * sent_bytes(serialise(layer))
            stream += layer.data
            assert sent_bits <= slots * slot_s * bitrate + 1e-6
    assert b"".join(map(stream_item, items)).startswith(stream)
    assert pacer.pending_items == 0 or sent_bits > 0.6 * len(frames) * slot_s * bitrate


def test_a_base_layer_is_a_debt_that_is_repaid_before_any_layer_is_sent() -> None:
    pacer = LayerPacer(8000)
    pacer.start(LayeredModel(MODEL, (bytes(500), bytes(500))))
    pacer.on_packet_sent(2000)
    due = [sum(len(layer.data) for layer in pacer.packets_due(0.25)) for _ in range(20)]
    assert due[:8] == [0] * 8 and sum(due) == 2 * (500 + 2)
    assert max(due) <= 0.25 * 8000 / 8


def test_credit_accrues_while_no_packet_is_due() -> None:
    pacer = LayerPacer(8000)
    pacer.start(LayeredModel(MODEL, (bytes(500),)))
    pacer.on_packet_sent(1000)
    pacer.packets_due(1)
    assert pacer.packets_due(1)


def test_added_modes_continue_the_stream() -> None:
    pacer, sent = LayerPacer(80_000), list[LayerPacket]()
    pacer.start(LayeredModel(MODEL, (b"", b"", bytes(300))))
    for added in (b"", b"one mode", b"another"):
        if added:
            pacer.add_mode(added)
            assert pacer.busy
        while pacer.busy:
            sent += pacer.packets_due(0.1)
    assert pacer.sent_items == 5
    assert [layer.number for layer in sent] == list(range(len(sent)))
    stream = b"".join(layer.data for layer in sent)
    assert stream == b"".join(map(stream_item, (b"", b"", bytes(300), b"one mode", b"another")))


def test_a_new_model_replaces_pending_items() -> None:
    pacer = LayerPacer(8000)
    pacer.start(LayeredModel(MODEL, (bytes(500), bytes(500))))
    pacer.start(LayeredModel(MODEL, (b"a", b"b")))
    assert [layer.data for layer in pacer.packets_due(1)] == [stream_item(b"a"), stream_item(b"b")]


def test_bytes_sent_grow_with_the_rate() -> None:
    sizes = []
    for bitrate in (4000, 8000, 16000):
        pacer = LayerPacer(bitrate)
        pacer.start(LayeredModel(MODEL, (bytes(9000), b"")))
        total = accumulate(sum(len(p.data) for p in pacer.packets_due(0.25)) for _ in range(8))
        sizes.append(list(total)[-1])
    assert sizes == sorted(sizes) and sizes[0] < 0.6 * sizes[1]
