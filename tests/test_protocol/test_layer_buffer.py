"""The layer buffer: every prefix of a stream makes a model, in any order of arrival."""

import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from layer_streams import (
    FIRST,
    ITEMS,
    KNOWN,
    LEARNED,
    MODES,
    STREAM,
    WHOLE,
    expected,
    learned_layers,
    pieces,
    transform_data,
)
from packets import MODEL

from protocol.entropy.varint import encode_varint
from protocol.errors import ProtocolError
from protocol.frames.transform_coding import parse_transform
from protocol.limits import MAX_IMAGE_BYTES, MAX_LAYER_BYTES, MAX_PROFILE_DATA_BYTES
from protocol.model_packet import ModelPacket
from protocol.packets import LayerPacket, parse_packet, serialise
from protocol.progressive_model import MAX_ITEMS, LayerBuffer, is_same_model, stream_item


def test_an_extensible_model_takes_no_pictures_from_layers() -> None:
    for pictures in ((b"junk", b""), (b"", b"junk")):
        stream = b"".join(map(stream_item, (*pictures, LEARNED[0])))
        with pytest.raises(ProtocolError, match="its own"):
            received([LayerPacket(3, 0, stream)], WHOLE)


def test_a_model_that_gets_its_background_late_is_the_same_model() -> None:
    bare = replace(WHOLE, background=b"")
    assert is_same_model(bare, WHOLE) and is_same_model(WHOLE, bare)
    assert not is_same_model(WHOLE, replace(WHOLE, background=b"another"))


def received(packets: list[LayerPacket], model: ModelPacket = FIRST) -> ModelPacket:
    layers = LayerBuffer()
    for packet in packets:
        layers.add(packet)
    return layers.apply(model)


@given(st.lists(st.integers(0, 1000), max_size=12))
def test_every_prefix_makes_a_model_with_its_complete_items(cuts: list[int]) -> None:
    packets, ends = pieces(STREAM, cuts), np.cumsum([len(stream_item(data)) for data in ITEMS])
    for count in range(len(packets) + 1):
        length = sum(len(packet.data) for packet in packets[:count])
        assert received(packets[:count]) == expected(int((ends <= length).sum()))


@given(st.lists(st.integers(0, 1000), max_size=12), st.randoms())
def test_order_and_repetition_change_nothing(cuts: list[int], rng: random.Random) -> None:
    packets = [*pieces(STREAM, cuts), *pieces(STREAM, cuts)]
    rng.shuffle(packets)
    layers, model, sizes = LayerBuffer(), FIRST, []
    for packet in packets:
        layers.add(packet)
        model = layers.apply(model)
        sizes.append(len(serialise(model)))
    assert model == expected(len(ITEMS)) and sizes == sorted(sizes)
    assert layers.apply(model) is model


def test_a_gap_waits_for_its_piece() -> None:
    packets = pieces(STREAM, [5, 40, 150])
    assert received([packets[0], *packets[2:]]) is FIRST


def test_an_empty_picture_leaves_that_of_the_model_packet() -> None:
    stream = b"".join(map(stream_item, (b"", b"", *ITEMS[2:])))
    model = received(pieces(stream, []))
    assert (model.texture, model.background) == (FIRST.texture, FIRST.background)
    assert parse_transform(model.profile_data).modes == ITEMS[2:]


def test_layers_of_another_version_are_ignored() -> None:
    assert received([LayerPacket(2, 0, STREAM)]) is FIRST


def test_bytes_by_item_add_up_to_the_bytes_received() -> None:
    layers = LayerBuffer()
    assert layers.bytes_by_item(3) == {}
    for packet in pieces(STREAM, [50]):
        layers.add(packet)
        parts = layers.bytes_by_item(3)
    assert parts == {
        "texture": len(ITEMS[0]),
        "background": len(ITEMS[1]),
        "modes": sum(map(len, ITEMS[2:])),
    }


@pytest.mark.parametrize(
    ("stream", "message"),
    [
        (STREAM + stream_item(b"fourth"), "4 modes"),
        (b"".join(map(stream_item, (*ITEMS[:2], b""))), "modes"),
        (encode_varint(MAX_IMAGE_BYTES + 1), "item 0"),
        (stream_item(b"x") + b"\xff\xff\xff\xff", "item 1"),
        (stream_item(b"x") + b"\x80\x00\x00", "bad number"),
        (bytes(MAX_ITEMS + 1), f"more than {MAX_ITEMS} items"),
    ],
)
def test_a_damaged_stream_is_refused_with_the_reason(stream: bytes, message: str) -> None:
    with pytest.raises(ProtocolError, match=message):
        received([LayerPacket(3, 0, stream)])


def test_items_beyond_the_limits_of_a_model_are_refused() -> None:
    stream = b"".join(map(stream_item, (b"", b"", *[bytes(MAX_PROFILE_DATA_BYTES // 2)] * 2)))
    with pytest.raises(ProtocolError, match="profile data has"):
        received(pieces(stream, list(range(0, len(stream), MAX_LAYER_BYTES))))


def test_an_incomplete_length_waits() -> None:
    assert received([LayerPacket(3, 0, stream_item(ITEMS[0]) + b"\x80")]) == expected(1)


def test_a_complete_model_takes_no_layers() -> None:
    with pytest.raises(ProtocolError, match="no layers"):
        received([LayerPacket(3, 0, STREAM)], replace(FIRST, progressive=False))


@pytest.mark.parametrize("count", [1, 2])
def test_reserved_modes_follow_those_of_the_model_packet(count: int) -> None:
    model = received(learned_layers(*LEARNED)[:count], WHOLE)
    assert parse_transform(model.profile_data).modes == (
        *KNOWN,
        *LEARNED[:count],
        *[b""] * (3 - count),
    )
    assert parse_transform(model.profile_data).reserved_modes == 3
    assert replace(model, profile_data=WHOLE.profile_data) == WHOLE


def test_applying_layers_again_changes_nothing_and_later_layers_continue() -> None:
    layers, (first, second) = LayerBuffer(), learned_layers(*LEARNED)
    layers.add(first)
    model = layers.apply(WHOLE)
    assert layers.apply(model) is model
    layers.add(second)
    assert layers.apply(model) == layers.apply(WHOLE) == received([first, second], WHOLE)


def test_reserved_modes_of_a_progressive_model_follow_all_others() -> None:
    blank = replace(FIRST, profile_data=transform_data((b"",) * len(KNOWN), 3))
    model = received(
        [LayerPacket(3, 0, b"".join(map(stream_item, (b"", b"", *KNOWN, *LEARNED))))], blank
    )
    assert parse_transform(model.profile_data).modes == (*KNOWN, *LEARNED, b"")


@pytest.mark.parametrize("modes", [(*LEARNED, b"third", b"fourth"), (*LEARNED, b"")])
def test_modes_beyond_the_capacity_are_refused(modes: tuple[bytes, ...]) -> None:
    with pytest.raises(ProtocolError, match="modes in layers, expected 3"):
        received(learned_layers(*modes), WHOLE)


@pytest.mark.parametrize("extension", [transform_data(KNOWN), b""])
def test_a_model_without_reserved_modes_takes_none(extension: bytes) -> None:
    with pytest.raises(ProtocolError, match="no layers"):
        received(learned_layers(*LEARNED), replace(WHOLE, profile_data=extension))


def test_the_buffer_is_bounded_and_dropping_versions_frees_it() -> None:
    layers = LayerBuffer(limit_bytes=1000)
    layers.add(LayerPacket(1, 0, bytes(400)))
    layers.add(LayerPacket(2, 7, bytes(400)))
    with pytest.raises(ProtocolError, match="more than 1000"):
        layers.add(LayerPacket(3, 0, STREAM))
    layers.drop_before(2)
    layers.add(LayerPacket(3, 0, STREAM))
    assert layers.apply(FIRST) == expected(len(ITEMS))


def test_small_packets_count_for_more_than_their_bytes() -> None:
    layers = LayerBuffer(limit_bytes=1000)
    with pytest.raises(ProtocolError):
        for number in range(1000 // LayerBuffer.OVERHEAD_BYTES + 1):
            layers.add(LayerPacket(1, number, b"x"))


def test_the_same_model_is_recognised_without_its_layers() -> None:
    whole = expected(len(ITEMS))
    assert is_same_model(FIRST, whole) and is_same_model(whole, FIRST)
    assert not is_same_model(FIRST, replace(whole, version=2))
    more = received(learned_layers(*LEARNED), WHOLE)
    assert is_same_model(WHOLE, more) and is_same_model(more, WHOLE)
    assert not is_same_model(WHOLE, replace(more, texture=b"another"))
    assert is_same_model(MODEL, replace(MODEL)) and not is_same_model(
        MODEL, replace(MODEL, texture=b"")
    )


@pytest.mark.no_cover
def test_fuzz_of_mutated_layers() -> None:
    seed = 20062
    print(f"seed {seed}")
    rng = random.Random(seed)
    for _ in range(2_000):
        stream = bytearray(STREAM)
        for _ in range(rng.randint(1, 4)):
            place = rng.randrange(len(stream))
            stream[place : place + rng.randint(0, 2)] = rng.randbytes(rng.randint(0, 2))
        layers, model = LayerBuffer(), FIRST
        for packet in pieces(bytes(stream), [rng.randrange(1000) for _ in range(3)]):
            try:
                layers.add(packet)
                model = layers.apply(model)
            except ProtocolError:
                continue
        again = parse_packet(serialise(model))
        assert again == model and len(parse_transform(model.profile_data).modes) == MODES
