"""Progressive models: layers arrive within the rate, and each of them improves the picture."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from call_contents import packets_of, raw_packets
from packets import sent_bytes
from shots import draw, talking
from videos import read_frames

from decoder.pipeline import DecodeOptions, DecodeReport, decode
from decoder.scene.appearance import FrameTextures
from decoder.scene.reenactment import read_model
from encoder.calls.call_session import RecordedPass
from encoder.calls.packet_sender import PacketSender
from encoder.calls.recorded_session import send_call
from encoder.calls.session_callbacks import SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.coding.pacer import LayerPacer
from encoder.coding.progressive_model import BASE_LAYER_BYTES
from encoder.options import EncodeOptions
from encoder.pipeline import EncodeRun, encode, first_and_second_pass
from loopback.quality.video_quality import face_mask_finder, measure_quality
from protocol.call_file import MAGIC, CallWriter
from protocol.call_records import serialise_records
from protocol.entropy.varint import decode_varint
from protocol.errors import ProtocolError
from protocol.frames.transform_coding import parse_transform, serialise_transform
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, parse_packet, serialise
from protocol.progressive_model import LayerBuffer
from protocol.summary import summarise

FRAMES, FPS = 52, 25
BITRATE, STARTUP, MODEL_BYTES = 1000.0, 16000.0, 6000


def test_a_startup_rate_no_larger_than_the_frames_rate_is_refused(
    tmp_path: Path, noise: Path
) -> None:
    for live in (False, True):
        options = EncodeOptions(
            str(noise), tmp_path / "call.rzo", bitrate=800, startup_bitrate=800, live=live
        )
        with pytest.raises(ValueError, match="startup bitrate is 800"):
            encode(options, lambda done, total: None, lambda: False)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory, networks: Path) -> str:
    folder = tmp_path_factory.mktemp("startup")
    draw(folder / "clip.mkv", talking(FRAMES / FPS, FPS, smile=0.6))
    return str(folder / "clip.mkv")


@pytest.fixture(scope="module")
def encoder(clip: str) -> Iterator[RecordedPass]:
    """After both passes over the clip: what can be sent in layers and without."""
    options, stats = EncodeOptions(clip, model_bytes=MODEL_BYTES), SessionStats()
    callbacks = SessionCallbacks(lambda done, total: None, lambda: False)
    with open_source(clip) as source:
        yield first_and_second_pass(EncodeRun(options, source, stats, callbacks))


def send(encoder: RecordedPass, path: Path, startup: float | None) -> tuple[str, ...]:
    """Send the call into a file, in layers at a startup rate; returns the warnings."""
    stats = SessionStats()
    pacer = None if startup is None else LayerPacer(startup, BITRATE)
    with CallWriter(path) as sink:
        encoded = encoder.encode(BITRATE, progressive=pacer is not None)
        send_call(encoded, PacketSender(sink, stats, pacer), None, lambda: False)
    return tuple(stats.warnings)


@pytest.fixture(scope="module")
def call(encoder: RecordedPass, clip: str) -> Path:
    path = Path(clip).with_name("call.rzo")
    send(encoder, path, STARTUP)
    return path


@pytest.fixture(scope="module")
def unpaced(encoder: RecordedPass, clip: str) -> Path:
    """The same call with all layers before its second frame packet."""
    path = Path(clip).with_name("unpaced.rzo")
    assert not any("not sent" in warning for warning in send(encoder, path, 1e7))
    return path


@pytest.fixture(scope="module")
def unlayered(encoder: RecordedPass, clip: str) -> Path:
    path = Path(clip).with_name("unlayered.rzo")
    send(encoder, path, None)
    return path


def write(path: Path, sent: list[bytes]) -> Path:
    path.write_bytes(MAGIC + serialise_records(sent))
    return path


def decoded(path: Path, video: Path) -> DecodeReport:
    options = DecodeOptions(path, output=video)
    return decode(options, lambda done, total: None, lambda: False)


def face_psnr_db(clip: str, video: Path) -> float:
    find_face_mask = face_mask_finder(pytest.fail)
    quality = measure_quality(clip, str(video), find_face_mask, lambda done, total: None)
    assert quality.face_psnr_db is not None
    return quality.face_psnr_db


def test_the_base_layer_is_small_and_has_no_modes(call: Path) -> None:
    first, *rest = packets_of(call)
    assert isinstance(first, ModelPacket) and first.progressive
    assert len(raw_packets(call)[0]) <= BASE_LAYER_BYTES
    modes = parse_transform(first.profile_data).modes
    assert modes and not any(modes)
    assert isinstance(rest[0], FramePacket)


def test_all_layers_make_the_model_of_a_call_without_layers(unpaced: Path, unlayered: Path) -> None:
    model, layers = None, LayerBuffer()
    for packet in packets_of(unpaced):
        if isinstance(packet, ModelPacket):
            model = packet
        elif isinstance(packet, LayerPacket):
            layers.add(packet)
    assert model is not None
    refined, (expected, *_) = layers.apply(model), packets_of(unlayered)
    assert isinstance(expected, ModelPacket) and not expected.progressive
    assert refined.profile_data == expected.profile_data
    assert (refined.texture, refined.background) == (expected.texture, expected.background)
    frames = [
        [p for p in packets_of(path) if isinstance(p, FramePacket)] for path in (unpaced, unlayered)
    ]
    assert frames[0] == frames[1]


def test_no_second_of_the_call_exceeds_the_rate(call: Path) -> None:
    time_s, sizes = 0.0, list[tuple[float, int]]()
    first, *rest = raw_packets(call)
    for data in rest:
        packet = parse_packet(data)
        if isinstance(packet, FramePacket):
            time_s += (8 if sizes else 1) / FPS
        sizes.append((time_s, 8 * sent_bytes(data)))
    slot_s = 8 / FPS
    for start, _ in sizes:
        window = sum(bits for at, bits in sizes if start <= at < start + 1)
        assert window <= STARTUP * (1 + slot_s)
    repaid_s = 8 * len(first) / STARTUP
    kinds = [type(parse_packet(data)) for data in rest]
    layers = [at for (at, _), kind in zip(sizes, kinds, strict=True) if kind is LayerPacket]
    assert layers and min(layers) >= repaid_s - slot_s


def test_a_call_that_ends_after_any_layer_is_decoded(call: Path, tmp_path: Path) -> None:
    sent = raw_packets(call)
    ends = [i + 1 for i, data in enumerate(sent) if isinstance(parse_packet(data), LayerPacket)]
    assert len(ends) > 3
    for end in (*ends[::3], ends[-1]):
        path = write(tmp_path / "cut.rzo", sent[:end])
        report = decoded(path, tmp_path / "cut.mkv")
        frames = sum(isinstance(parse_packet(data), FramePacket) for data in sent[:end])
        assert report.frames == min(1 + 8 * (frames - 1), FRAMES)
        assert report.warnings == ("the call has no end: decoded up to its last packet",)


def test_every_layer_raises_the_psnr_of_the_face(unpaced: Path, clip: str, tmp_path: Path) -> None:
    sent = raw_packets(unpaced)
    layers = [data for data in sent[1:] if isinstance(parse_packet(data), LayerPacket)]
    others = [data for data in sent[1:] if data not in layers]
    psnr_db = []
    for count in (0, 1, 3, len(layers)):
        path = write(tmp_path / f"{count}.rzo", [sent[0], *layers[:count], *others])
        report = decoded(path, tmp_path / f"{count}.mkv")
        assert report.frames == FRAMES and not report.warnings
        psnr_db.append(face_psnr_db(clip, tmp_path / f"{count}.mkv"))
    assert all(np.diff(psnr_db) > 0) and all(np.diff(psnr_db[:3]) > 1)


def test_a_call_in_layers_has_the_pictures_of_one_without(
    unpaced: Path, unlayered: Path, tmp_path: Path
) -> None:
    """From the frame on before which all layers have come."""
    pictures = []
    for call in (unpaced, unlayered):
        decoded(call, tmp_path / f"{call.stem}.mkv")
        pictures.append(read_frames(tmp_path / f"{call.stem}.mkv"))
    for one, other in zip(pictures[0][1:], pictures[1][1:], strict=True):
        np.testing.assert_array_equal(one, other)


def test_applying_layers_one_by_one_gives_the_same_texture(unpaced: Path, unlayered: Path) -> None:
    """Decoding modes one after the other is decoding all of them."""
    first, *rest = packets_of(unpaced)
    assert isinstance(first, ModelPacket)
    appearance, layers, model = FrameTextures(first), LayerBuffer(), first
    assert not appearance.has_modes
    for packet in rest:
        if isinstance(packet, LayerPacket):
            layers.add(packet)
            model = layers.apply(model)
            appearance.update(model)
    expected = packets_of(unlayered)[0]
    assert isinstance(expected, ModelPacket) and appearance.has_modes
    coefficients = np.linspace(-3, 3, len(parse_transform(expected.profile_data).modes))
    np.testing.assert_array_equal(
        appearance.synthesise(coefficients), FrameTextures(expected).synthesise(coefficients)
    )


def test_a_damaged_layer_leaves_the_appearance_as_it_was(unpaced: Path, tmp_path: Path) -> None:
    sent = raw_packets(unpaced)
    indices = [i for i, data in enumerate(sent) if isinstance(parse_packet(data), LayerPacket)]
    last, other = parse_packet(sent[indices[-1]]), tmp_path / "without.mkv"
    assert isinstance(last, LayerPacket)
    # A mode's first byte is its step, and no step is so large.
    _, step = decode_varint(last.data)
    damaged = replace(last, data=last.data[:step] + b"\xff" + last.data[step + 1 :])
    sent[indices[-1]] = serialise(damaged)
    report = decoded(write(tmp_path / "damaged.rzo", sent), tmp_path / "damaged.mkv")
    assert report.frames == FRAMES
    (warning,) = report.warnings
    assert warning.startswith("damaged packet: ") and "no step" in warning
    # All other layers are used, also the background, whose layer packet holds the damaged mode.
    decoded(write(tmp_path / "without.rzo", sent[: indices[-1]] + sent[indices[-1] + 1 :]), other)
    for one, same in zip(read_frames(tmp_path / "damaged.mkv"), read_frames(other), strict=True):
        np.testing.assert_array_equal(one, same)


def test_a_damaged_texture_is_reported_once_and_leaves_the_texture_as_it_was(
    unlayered: Path,
) -> None:
    model = packets_of(unlayered)[0]
    assert isinstance(model, ModelPacket)
    appearance, damaged = FrameTextures(model), replace(model, texture=b"RIFF no picture")
    before = appearance.synthesise(np.zeros(0)).copy()
    with pytest.raises(ProtocolError, match="texture"):
        appearance.update(damaged)
    appearance.update(damaged)
    np.testing.assert_array_equal(appearance.synthesise(np.zeros(0)), before)


def test_modes_before_a_damaged_one_are_used_and_not_decoded_again(unlayered: Path) -> None:
    model = packets_of(unlayered)[0]
    assert isinstance(model, ModelPacket)
    transform = parse_transform(model.profile_data)
    assert len(transform.modes) > 1

    def with_modes(*modes: bytes) -> ModelPacket:
        missing = (b"",) * (len(transform.modes) - len(modes))
        profile_data = serialise_transform(replace(transform, modes=modes + missing))
        return replace(model, profile_data=profile_data, progressive=True)

    appearance = FrameTextures(with_modes())
    with pytest.raises(ProtocolError, match="mode 1 has no step"):
        appearance.update(with_modes(transform.modes[0], b"\xff"))
    appearance.update(with_modes(transform.modes[0], b"\xff", *transform.modes[2:]))
    coefficients = np.linspace(-3, 3, len(transform.modes))
    expected = FrameTextures(with_modes(transform.modes[0]))
    np.testing.assert_array_equal(
        appearance.synthesise(coefficients), expected.synthesise(coefficients)
    )


def test_a_model_for_reenactment_has_all_layers(unpaced: Path, unlayered: Path) -> None:
    model_of_call, expected = read_model(unpaced), read_model(unlayered)
    assert replace(model_of_call, progressive=False) == expected


def test_the_bytes_of_a_call_in_layers_add_up(call: Path) -> None:
    summary = summarise(call)
    sent = raw_packets(call)
    assert summary.layer_packets == sum(isinstance(p, LayerPacket) for p in packets_of(call)) > 3
    assert summary.model_packets == 1
    assert sum(summary.model_parts.values()) == summary.model_bytes
    assert min(summary.model_parts.values()) >= 0
    parts = summary.model_bytes + summary.frame_bytes + summary.control_bytes
    assert parts + summary.container_bytes == summary.file_bytes
    assert summary.container_bytes == 4 + len(serialise_records(sent)) - sum(
        len(packet) - 1 for packet in sent
    )


def test_a_call_too_short_for_its_layers_warns(encoder: RecordedPass, tmp_path: Path) -> None:
    path = tmp_path / "thin.rzo"
    assert any("not sent" in warning for warning in send(encoder, path, BITRATE + 500))
    assert decoded(path, tmp_path / "thin.mkv").frames == FRAMES
