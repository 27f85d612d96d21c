"""A paced start: layers keep to the rate, and each of them makes the picture better."""

from dataclasses import replace
from itertools import accumulate
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from packets import MODEL
from shots import draw
from test_decoder_pipeline import read

from decoder.appearance import AppearanceModel
from decoder.pipeline import DecodeOptions, DecodeReport, decode
from decoder.reenactment import read_model
from encoder.coding.pacer import LayerPacer
from encoder.coding.progressive_model import BASE_LAYER_BYTES, LayeredModel
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from encoder.report import EncodeReport
from loopback.quality import face_mask_finder, measure_quality
from protocol.call_file import MAGIC, CallReader, serialise_record
from protocol.entropy.varint import decode_varint
from protocol.errors import ProtocolError
from protocol.frames.frame_transform import parse_transform, serialise_transform
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, Packet, parse_packet, serialise
from protocol.progressive_model import LayerBuffer, stream_item
from protocol.summary import summarise

FRAMES, FPS = 60, 25
BITRATE, STARTUP, MODEL_BYTES = 1000.0, 12000.0, 4500
SCRIPT = """
width = 160
height = 120
fps = 25
seconds = 2.4
distance_mm = 420
noise = 1
[[key]]
time = 0
pose = { yaw = -6 }
eau = { jaw_drop = 0, mouth_corners = 0 }
[[key]]
time = 0.8
pose = { yaw = 6 }
eau = { jaw_drop = 0.6 }
[[key]]
time = 1.6
pose = { yaw = 0, pitch = 4 }
eau = { jaw_drop = 0, mouth_corners = 0.6 }
[[key]]
time = 2.4
pose = { yaw = -4, pitch = 0 }
eau = { jaw_drop = 0.5, mouth_corners = 0 }
"""


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
    for turn, size in enumerate(frames, start=1):
        pacer.on_packet_sent(size)
        sent_bits += 8 * (size + 1)
        for layer in pacer.packets_due(slot_s):
            sent_bits += 8 * len(serialise_record(serialise(layer)))
            stream += layer.data
            assert sent_bits <= turn * slot_s * bitrate + 1e-6
    assert b"".join(map(stream_item, items)).startswith(stream)
    assert pacer.pending_items == 0 or sent_bits > 0.6 * len(frames) * slot_s * bitrate


def test_a_first_layer_is_a_debt_that_is_paid_before_anything_else() -> None:
    pacer = LayerPacer(8000)
    pacer.start(LayeredModel(MODEL, (bytes(500), bytes(500))))
    pacer.on_packet_sent(2000)
    due = [sum(len(layer.data) for layer in pacer.packets_due(0.25)) for _ in range(20)]
    assert due[:8] == [0] * 8 and sum(due) == 2 * (500 + 2)
    assert max(due) <= 0.25 * 8000 / 8


def test_a_rate_that_leaves_nothing_for_layers_is_refused(tmp_path: Path, noise: Path) -> None:
    for live in (False, True):
        options = EncodeOptions(
            str(noise), tmp_path / "call.rzo", bitrate=800, startup_bitrate=800, live=live
        )
        with pytest.raises(ValueError, match="startup bitrate is 800"):
            encode(options, lambda done, total: None, lambda: False)


def test_time_counts_even_if_nobody_looks_at_what_is_due() -> None:
    pacer = LayerPacer(8000)
    pacer.start(LayeredModel(MODEL, (bytes(500),)))
    pacer.on_packet_sent(1000)
    pacer.packets_due(1)
    assert pacer.packets_due(1)


def test_modes_that_are_added_go_on_with_the_same_stream() -> None:
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


def test_a_new_model_takes_the_place_of_what_was_waiting() -> None:
    pacer = LayerPacer(8000)
    pacer.start(LayeredModel(MODEL, (bytes(500), bytes(500))))
    pacer.start(LayeredModel(MODEL, (b"a", b"b")))
    assert [layer.data for layer in pacer.packets_due(1)] == [stream_item(b"a"), stream_item(b"b")]


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, networks: Path) -> str:
    folder = tmp_path_factory.mktemp("startup")
    draw(folder / "clip.mkv", SCRIPT)
    return str(folder / "clip.mkv")


def encoded(clip: str, output: Path, startup: float | None) -> EncodeReport:
    options = EncodeOptions(
        clip,
        output,
        profile="default",
        bitrate=BITRATE,
        model_bytes=MODEL_BYTES,
        startup_bitrate=startup,
    )
    return encode(options, lambda done, total: None, lambda: False)


@pytest.fixture(scope="module")
def call(clip: str) -> Path:
    path = Path(clip).with_name("call.rzo")
    encoded(clip, path, STARTUP)
    return path


@pytest.fixture(scope="module")
def at_once(clip: str) -> Path:
    """The same with all layers before the first slot has passed."""
    path = Path(clip).with_name("at_once.rzo")
    assert encoded(clip, path, 1e7).warnings == ()
    return path


@pytest.fixture(scope="module")
def whole(clip: str) -> Path:
    path = Path(clip).with_name("whole.rzo")
    encoded(clip, path, None)
    return path


def raw_packets(path: Path) -> list[bytes]:
    with CallReader(path) as reader:
        return list(reader)


def packets(path: Path) -> list[Packet]:
    return [parse_packet(data) for data in raw_packets(path)]


def write(path: Path, given: list[bytes]) -> Path:
    path.write_bytes(MAGIC + b"".join(map(serialise_record, given)))
    return path


def decoded(path: Path, video: Path) -> DecodeReport:
    options = DecodeOptions(path, output=video)
    return decode(options, lambda done, total: None, lambda: False)


def face_psnr_db(clip: str, video: Path) -> float:
    find_face_mask = face_mask_finder(pytest.fail)
    quality = measure_quality(clip, str(video), find_face_mask, lambda done, total: None)
    assert quality.face_psnr_db is not None
    return quality.face_psnr_db


def test_the_first_layer_is_small_and_has_no_modes(call: Path) -> None:
    first, *rest = packets(call)
    assert isinstance(first, ModelPacket) and first.progressive
    assert len(raw_packets(call)[0]) <= BASE_LAYER_BYTES
    modes = parse_transform(first.profile_data).modes
    assert modes and not any(modes)
    assert isinstance(rest[0], FramePacket)


def test_the_layers_make_the_model_that_is_otherwise_sent_whole(at_once: Path, whole: Path) -> None:
    model, layers = None, LayerBuffer()
    for packet in packets(at_once):
        if isinstance(packet, ModelPacket):
            model = packet
        elif isinstance(packet, LayerPacket):
            layers.add(packet)
    assert model is not None
    refined, (expected, *_) = layers.apply(model), packets(whole)
    assert isinstance(expected, ModelPacket) and not expected.progressive
    assert refined.profile_data == expected.profile_data
    assert (refined.texture, refined.background) == (expected.texture, expected.background)
    frames = [[p for p in packets(path) if isinstance(p, FramePacket)] for path in (at_once, whole)]
    assert frames[0] == frames[1]


def test_no_second_of_the_call_takes_more_than_the_rate(call: Path) -> None:
    time_s, sizes = 0.0, list[tuple[float, int]]()
    first, *rest = raw_packets(call)
    for data in rest:
        packet = parse_packet(data)
        if isinstance(packet, FramePacket):
            time_s += (8 if sizes else 1) / FPS
        sizes.append((time_s, 8 * len(serialise_record(data))))
    slot_s = 8 / FPS
    for start, _ in sizes:
        window = sum(bits for at, bits in sizes if start <= at < start + 1)
        assert window <= STARTUP * (1 + slot_s)
    paid_s = 8 * len(first) / STARTUP
    layers = [
        at
        for (at, _), data in zip(sizes, rest, strict=True)
        if isinstance(parse_packet(data), LayerPacket)
    ]
    assert layers and min(layers) >= paid_s - slot_s


def test_cut_after_any_layer_a_call_has_its_pictures(call: Path, tmp_path: Path) -> None:
    given = raw_packets(call)
    ends = [i + 1 for i, data in enumerate(given) if isinstance(parse_packet(data), LayerPacket)]
    assert len(ends) > 3
    for end in ends:
        path = write(tmp_path / "cut.rzo", given[:end])
        report = decoded(path, tmp_path / "cut.mkv")
        frames = sum(isinstance(parse_packet(data), FramePacket) for data in given[:end])
        assert report.frames == min(1 + 8 * (frames - 1), FRAMES)
        assert report.warnings == ("the call has no end: decoded up to its last packet",)


def test_every_layer_makes_the_face_better(at_once: Path, clip: str, tmp_path: Path) -> None:
    given = raw_packets(at_once)
    layers = [data for data in given[1:] if isinstance(parse_packet(data), LayerPacket)]
    others = [data for data in given[1:] if data not in layers]
    psnr_db = []
    for count in (0, 1, 3, len(layers)):
        path = write(tmp_path / f"{count}.rzo", [given[0], *layers[:count], *others])
        report = decoded(path, tmp_path / f"{count}.mkv")
        assert report.frames == FRAMES and not report.warnings
        psnr_db.append(face_psnr_db(clip, tmp_path / f"{count}.mkv"))
    assert all(np.diff(psnr_db) > 0.1) and psnr_db[-1] > psnr_db[0] + 2


def test_a_layered_call_ends_as_good_as_a_whole_one(
    at_once: Path, whole: Path, clip: str, tmp_path: Path
) -> None:
    for path in (at_once, whole):
        decoded(path, tmp_path / f"{path.stem}.mkv")
    one, other = (face_psnr_db(clip, tmp_path / f"{p.stem}.mkv") for p in (at_once, whole))
    assert one == pytest.approx(other, abs=0.3)


def test_who_draws_layer_by_layer_draws_the_same(at_once: Path, whole: Path) -> None:
    """Decoding modes one after the other is decoding all of them."""
    first, *rest = packets(at_once)
    assert isinstance(first, ModelPacket)
    wardrobe, layers, model = AppearanceModel(first), LayerBuffer(), first
    assert not wardrobe.has_modes
    for packet in rest:
        if isinstance(packet, LayerPacket):
            layers.add(packet)
            model = layers.apply(model)
            wardrobe.update(model)
    expected = packets(whole)[0]
    assert isinstance(expected, ModelPacket) and wardrobe.has_modes
    coefficients = np.linspace(-3, 3, len(parse_transform(expected.profile_data).modes))
    np.testing.assert_array_equal(
        wardrobe.synthesise(coefficients), AppearanceModel(expected).synthesise(coefficients)
    )


def test_a_damaged_layer_leaves_what_was_drawn_before(at_once: Path, tmp_path: Path) -> None:
    given = raw_packets(at_once)
    places = [i for i, data in enumerate(given) if isinstance(parse_packet(data), LayerPacket)]
    last, other = parse_packet(given[places[-1]]), tmp_path / "without.mkv"
    assert isinstance(last, LayerPacket)
    # A mode's first byte is its step, and no step is so large.
    _, step = decode_varint(last.data)
    damaged = replace(last, data=last.data[:step] + b"\xff" + last.data[step + 1 :])
    given[places[-1]] = serialise(damaged)
    report = decoded(write(tmp_path / "damaged.rzo", given), tmp_path / "damaged.mkv")
    assert report.frames == FRAMES
    (warning,) = report.warnings
    assert warning.startswith("damaged packets: 1,") and "no step" in warning
    # All else is drawn, the whole still too, though it came with the damaged mode.
    decoded(write(tmp_path / "without.rzo", given[: places[-1]] + given[places[-1] + 1 :]), other)
    for one, same in zip(read(tmp_path / "damaged.mkv"), read(other), strict=True):
        np.testing.assert_array_equal(one, same)


def test_a_damaged_texture_is_told_once_and_the_one_before_worn(whole: Path) -> None:
    model = packets(whole)[0]
    assert isinstance(model, ModelPacket)
    wardrobe, damaged = AppearanceModel(model), replace(model, texture=b"RIFF no picture")
    before = wardrobe.synthesise(np.zeros(0)).copy()
    with pytest.raises(ProtocolError, match="texture"):
        wardrobe.update(damaged)
    wardrobe.update(damaged)
    np.testing.assert_array_equal(wardrobe.synthesise(np.zeros(0)), before)


def test_modes_before_a_damaged_one_are_worn_and_not_decoded_again(whole: Path) -> None:
    model = packets(whole)[0]
    assert isinstance(model, ModelPacket)
    components = parse_transform(model.profile_data)
    assert len(components.modes) > 1

    def with_modes(*modes: bytes) -> ModelPacket:
        missing = (b"",) * (len(components.modes) - len(modes))
        extension = serialise_transform(replace(components, modes=modes + missing))
        return replace(model, profile_data=extension, progressive=True)

    wardrobe = AppearanceModel(with_modes())
    with pytest.raises(ProtocolError, match="mode 1 has no step"):
        wardrobe.update(with_modes(components.modes[0], b"\xff"))
    wardrobe.update(with_modes(components.modes[0], b"\xff", *components.modes[2:]))
    coefficients = np.linspace(-3, 3, len(components.modes))
    expected = AppearanceModel(with_modes(components.modes[0]))
    np.testing.assert_array_equal(
        wardrobe.synthesise(coefficients), expected.synthesise(coefficients)
    )


def test_whose_face_is_worn_has_all_layers(at_once: Path, whole: Path) -> None:
    worn, expected = read_model(at_once), read_model(whole)
    assert replace(worn, progressive=False) == expected


def test_the_parts_of_a_layered_call_add_up(call: Path) -> None:
    summary = summarise(call)
    given = raw_packets(call)
    assert summary.layer_packets == sum(isinstance(p, LayerPacket) for p in packets(call)) > 3
    assert summary.model_packets == 1
    assert sum(summary.model_parts.values()) == summary.model_bytes
    assert min(summary.model_parts.values()) >= 0
    parts = summary.model_bytes + summary.frame_bytes + summary.control_bytes
    assert parts + summary.container_bytes == summary.file_bytes
    assert summary.container_bytes == 4 + sum(len(serialise_record(p)) - len(p) + 1 for p in given)


def test_a_call_too_short_for_its_model_says_so(clip: str, tmp_path: Path) -> None:
    report = encoded(clip, tmp_path / "thin.rzo", BITRATE + 500)
    assert any("not sent" in warning for warning in report.warnings)
    assert decoded(tmp_path / "thin.rzo", tmp_path / "thin.mkv").frames == FRAMES


def test_sizes_of_layers_grow_with_the_rate() -> None:
    sizes = []
    for bitrate in (4000, 8000, 16000):
        pacer = LayerPacer(bitrate)
        pacer.start(LayeredModel(MODEL, (bytes(9000), b"")))
        total = accumulate(sum(len(p.data) for p in pacer.packets_due(0.25)) for _ in range(8))
        sizes.append(list(total)[-1])
    assert sizes == sorted(sizes) and sizes[0] < 0.6 * sizes[1]
