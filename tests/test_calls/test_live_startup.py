"""A live call on a thin link: its models come in layers, and frames flow from the start."""

from itertools import combinations
from pathlib import Path

import pytest
from call_contents import raw_packets
from packets import sent_bytes
from shots import draw, talking

from decoder.pipeline import DecodeOptions, decode
from decoder.playout.playout import Playout
from encoder.calls.model_updates import MIN_ITEMS_BEFORE_SWITCH, lead_packets
from encoder.calls.packet_sender import LEAD_PACKETS
from encoder.coding.progressive_model import BASE_LAYER_BYTES, UPDATE_BASE_LAYER_BYTES
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from encoder.report import EncodeReport
from protocol.frames.transform_coding import parse_transform
from protocol.limits import SEQUENCE_MODULUS
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, parse_packet
from protocol.progressive_model import LayerBuffer
from protocol.summary import summarise

FRAMES, FPS, PACKED = 90, 25, 8
BITRATE, STARTUP, MODEL_BYTES = 1000.0, 60_000.0, 6000


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, networks: Path) -> Path:
    folder = tmp_path_factory.mktemp("live")
    draw(folder / "clip.mkv", talking(3.6))
    return folder / "clip.mkv"


def encoded(
    clip: Path, output: Path, startup: float, frames: int | None = None, wait_s: float = 0.0
) -> EncodeReport:
    options = EncodeOptions(
        str(clip),
        output,
        profile="default",
        live=True,
        bitrate=BITRATE,
        startup_bitrate=startup,
        model_bytes=MODEL_BYTES,
        max_frames=frames,
        wait_for_peer_s=wait_s,
    )
    return encode(options, lambda done, total: None, lambda: False)


@pytest.fixture(scope="module")
def call(clip: Path) -> Path:
    path = clip.with_name("call.rzo")
    encoded(clip, path, STARTUP)
    return path


def known_modes(model: ModelPacket) -> tuple[bytes, ...]:
    """The modes that a model was learned with, empty where they have not come."""
    components = parse_transform(model.profile_data)
    return components.modes[: len(components.modes) - components.reserved_modes]


def test_an_updates_first_layers_go_before_its_model_the_other_modes_after(call: Path) -> None:
    packets = [parse_packet(data) for data in raw_packets(call)]
    models = {p.version: i for i, p in enumerate(packets) if isinstance(p, ModelPacket)}
    assert list(models) == [0, 1] and models[0] == 0
    first, update = (packets[place] for place in models.values())
    assert isinstance(first, ModelPacket) and isinstance(update, ModelPacket)
    assert first.progressive and update.progressive
    assert len(raw_packets(call)[0]) <= BASE_LAYER_BYTES
    assert len(raw_packets(call)[models[1]]) <= UPDATE_BASE_LAYER_BYTES
    layers, early = LayerBuffer(), LayerBuffer()
    for place, packet in enumerate(packets):
        if isinstance(packet, LayerPacket):
            layers.add(packet)
            if place < models[1]:
                early.add(packet)
    modes, ahead = (known_modes(came.apply(update)) for came in (layers, early))
    assert modes and all(modes)
    assert early.apply(update).texture == layers.apply(update).texture != update.texture
    assert sum(map(bool, ahead)) >= min(MIN_ITEMS_BEFORE_SWITCH - 2, len(modes))
    before = sum(isinstance(packet, FramePacket) for packet in packets[: models[1]])
    assert update.sequence >= before + LEAD_PACKETS
    assert update.call.start_frame == 1 + (update.sequence - 1) * PACKED


@pytest.mark.parametrize(
    ("carried_s", "packets"),
    [(0.1, LEAD_PACKETS + 1), (1.2, LEAD_PACKETS + 4), (24.0, SEQUENCE_MODULUS // 2 - 1)],
)
def test_an_update_is_announced_no_farther_than_its_number_tells(
    carried_s: float, packets: int
) -> None:
    assert lead_packets(carried_s, PACKED / FPS) == packets


def test_an_update_takes_effect_with_its_pictures_and_modes(call: Path) -> None:
    playout, shown = Playout(), []
    for data in raw_packets(call):
        for frame in playout.receive(parse_packet(data)):
            assert playout.model is not None
            shown.append((frame.index, playout.model))
    assert [index for index, _ in shown] == list(range(FRAMES))
    rough = next(model for _, model in shown if model.version == 0)
    updated = [model for _, model in shown if model.version == 1]
    for model in (updated[0], updated[-1]):
        assert len(model.texture) > len(rough.texture)
        assert len(model.background) > len(rough.background)
        assert all(known_modes(model)[: MIN_ITEMS_BEFORE_SWITCH - 2])


def test_frames_layers_and_models_keep_to_the_rate(call: Path) -> None:
    bits, slots = 0, list[int]()
    for data in raw_packets(call)[1:]:
        packet = parse_packet(data)
        if isinstance(packet, FramePacket):
            slots.append(bits)
            bits = 0
        bits += 8 * sent_bytes(data)
    slot_bits = STARTUP * PACKED / FPS
    # An update's model packet goes at once, as a debt that the slots after it pay.
    debt = 8 * UPDATE_BASE_LAYER_BYTES
    for first, end in combinations(range(2, len(slots) + 1), 2):
        assert sum(slots[first:end]) <= (end - first) * slot_bits + debt + 8 * 64
    assert max(slots[2:]) > slot_bits / 2


def test_the_model_that_was_made_while_nobody_had_come_is_sent(call: Path, clip: Path) -> None:
    """Of the first face: the same as without a wait."""
    waited = clip.with_name("waited.rzo")
    encoded(clip, waited, STARTUP, frames=2 * PACKED, wait_s=1)
    count = len(raw_packets(waited)) - 2  # the last packets have fewer frames, and the end
    assert count > 1
    assert raw_packets(waited)[:count] == raw_packets(call)[:count]


def test_a_live_call_in_layers_is_drawn(call: Path, tmp_path: Path) -> None:
    report = decode(
        DecodeOptions(call, output=tmp_path / "out.mkv"), lambda done, total: None, lambda: False
    )
    assert report.frames == FRAMES and not report.warnings
    assert report.model_bytes == summarise(call).model_bytes


def test_a_call_that_ends_early_says_what_is_missing(clip: Path, tmp_path: Path) -> None:
    report = encoded(clip, tmp_path / "short.rzo", 3000, frames=20)
    assert any("no more of its model" in warning for warning in report.warnings)
