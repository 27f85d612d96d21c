"""A live call learns modes: they reach the decoder, and what it draws is better."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from call_contents import packets_of
from conftest import LIVE_MODEL_BYTES, without_layers
from predicted_frames import decode_payload
from videos import read_frames

from decoder.pipeline import DecodeOptions, decode
from decoder.scene.appearance import FrameTextures
from encoder.calls.model_states import TRANSITIONS, ModelState
from encoder.calls.session_callbacks import CallEvents
from encoder.coding.rdo_quantiser import CodedPacket
from encoder.live_model.model_schedule import MODE_SPENDING_EXPONENT
from encoder.live_model.model_version import RESERVED_MODES, ModelVersion
from encoder.live_model.pacing import UNPACED
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from protocol.call_file import MAGIC
from protocol.call_records import serialise_records
from protocol.frames.temporal_prediction import FramePredictor
from protocol.frames.transform_coding import parse_transform, serialise_transform
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, Packet, serialise
from protocol.progressive_model import LayerBuffer
from shared_model.arrays import Array, Integers, Picture

# Light comes from one side once the first update is in use.
FRAMES, LATE, PACKED = 75, 55, 8
# Enough for an update.
FEWER = 57
# Which of eight frames are dark.
GAP = (3, 4)


@dataclass(frozen=True, slots=True)
class Sent:
    """What an encoder meant to send, and how its model went on.

    modes: by the number of their version.  targets, frames: the values of each packet's frames, as
        they were fitted and as they were coded.
    states: that the model entered.
    """

    path: Path
    states: list[ModelState] = field(default_factory=list)
    modes: dict[int, list[bytes]] = field(default_factory=dict)
    targets: list[Array] = field(default_factory=list)
    frames: list[Integers] = field(default_factory=list)

    def packets(self) -> list[Packet]:
        return packets_of(self.path)


@pytest.fixture(scope="module")
def clip(talking_clip: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(shutil.copy(talking_clip, tmp_path_factory.mktemp("growth")))


@pytest.fixture(scope="module", params=[None, 200_000.0], ids=["whole", "in layers"])
def sent(clip: Path, request: pytest.FixtureRequest) -> Sent:
    if request.param is None:
        return send(clip)
    with without_layers():
        return send(clip, request.param)


def send(clip: Path, startup_bitrate: float | None = None, frames: int | None = None) -> Sent:
    found = Sent(clip.with_suffix(".rzo"))

    def on_packet(targets: Array, packet: CodedPacket) -> None:
        found.targets.append(targets)
        found.frames.append(packet.frames)

    def on_mode(version: ModelVersion, mode: bytes) -> None:
        found.modes.setdefault(version.number, []).append(mode)

    events = CallEvents(found.states.append, on_mode, on_packet)
    options = EncodeOptions(
        str(clip),
        found.path,
        live=True,
        startup_bitrate=startup_bitrate,
        model_bytes=LIVE_MODEL_BYTES,
        max_frames=frames,
    )
    encode(options, lambda done, total: None, lambda: False, events=events)
    return found


def drawn(packets: Sequence[Packet], path: Path) -> list[Picture]:
    path.write_bytes(MAGIC + serialise_records(serialise(packet) for packet in packets))
    video = path.with_suffix(".mkv")
    report = decode(DecodeOptions(path, output=video), lambda done, total: None, lambda: False)
    assert report.frames == FRAMES and not report.warnings
    return read_frames(video)


def late_face_psnr_db(wanted: list[Picture], found: list[Picture]) -> float:
    """Of luma in the middle of the later pictures, where the face is."""
    errors = [
        cv2.cvtColor(one, cv2.COLOR_BGR2GRAY)[25:95, 50:110].astype(float)
        - cv2.cvtColor(other, cv2.COLOR_BGR2GRAY)[25:95, 50:110]
        for one, other in zip(wanted[LATE:], found[LATE:], strict=True)
    ]
    return float(np.mean([10 * np.log10(255**2 / (error**2).mean()) for error in errors]))


@pytest.mark.parametrize("sent", [None], ids=["whole"], indirect=True)
def test_the_same_source_gives_the_same_bytes(sent: Sent, live_call: Path) -> None:
    assert sent.path.read_bytes() == live_call.read_bytes()


def test_the_decoder_has_the_encoders_modes_of_each_model(sent: Sent) -> None:
    layers, models = LayerBuffer(), list[ModelPacket]()
    for packet in sent.packets():
        if isinstance(packet, LayerPacket):
            layers.add(packet)
        elif isinstance(packet, ModelPacket):
            models.append(packet)
    assert [model.version for model in models] == [0, 1] and sent.modes[0] and sent.modes[1]
    for model in models:
        components = parse_transform(layers.apply(model).profile_data)
        found = components.modes[len(components.modes) - components.reserved_modes :]
        assert found == (*sent.modes[model.version], *found[len(sent.modes[model.version]) :])
        assert not any(found[len(sent.modes[model.version]) :])


def test_the_model_goes_through_the_states_of_the_table(sent: Sent) -> None:
    assert sent.states[0] is ModelState.CODING and sent.states[-1] is ModelState.ENDED
    assert ModelState.ANNOUNCED in sent.states
    for before, after in pairwise(sent.states):
        assert after in TRANSITIONS[before].values()


def frames_and_modes(packets: Sequence[Packet]) -> list[tuple[Integers, int]]:
    """The frames of each packet as a decoder reads them, and how many of their last values are of
    reserved modes."""
    announced: list[ModelPacket] = []
    found: list[tuple[Integers, int]] = []
    for packet in packets:
        if isinstance(packet, ModelPacket):
            announced.append(packet)
        elif isinstance(packet, FramePacket):
            if announced and packet.sequence == announced[0].sequence:
                model, first = announced.pop(0), len(found)
                components = parse_transform(model.profile_data)
                predictor = FramePredictor(components.scale_codes, components.reserved_modes)
            frames = decode_payload(
                predictor, len(found) - first, model.call.frames_per_packet, packet.payload
            )
            found.append((np.array(frames), components.reserved_modes))
    assert not announced
    return found


def test_the_decoder_has_the_encoders_frames_while_modes_come_into_use(sent: Sent) -> None:
    found = frames_and_modes(sent.packets())
    assert all(
        np.array_equal(frames, own) for (frames, _), own in zip(found, sent.frames, strict=True)
    )
    used = {int(frames[:, -reserved:].any(0).sum()) for frames, reserved in found}
    assert 0 in used and len(used) > 2


@pytest.mark.parametrize("sent", [None], ids=["whole"], indirect=True)
def test_all_faces_of_a_packet_have_the_modes_learned_before_it_is_sent(sent: Sent) -> None:
    models = [packet for packet in sent.packets() if isinstance(packet, ModelPacket)]
    entries = [model.sequence for model in models]
    reserved = parse_transform(models[0].profile_data).reserved_modes
    used, faces = 0, list[bool]()
    for number, target in enumerate(sent.targets):
        learned = target[:, -reserved:] != 0
        count = int(learned.any(0).sum())
        if number not in entries and count > used:
            faces.extend(learned[:, used:count].all(1).tolist())
        used = count
    # A face that its new modes do not bring nearer to the picture stays as it was.
    assert len(faces) > PACKED and np.mean(faces) > 0.95


@pytest.mark.parametrize("sent", [None], ids=["whole"], indirect=True)
def test_learned_modes_make_the_picture_better(sent: Sent, clip: Path, tmp_path: Path) -> None:
    wanted, packets = read_frames(clip), sent.packets()
    without = [packet for packet in packets if not isinstance(packet, LayerPacket)]
    with_them = late_face_psnr_db(wanted, drawn(packets, tmp_path / "all.rzo"))
    assert with_them > late_face_psnr_db(wanted, drawn(without, tmp_path / "bare.rzo")) + 4
    assert with_them > 32


@pytest.mark.parametrize("sent", [None], ids=["whole"], indirect=True)
def test_modes_added_to_a_model_that_is_drawn_do_not_change_it(sent: Sent) -> None:
    model = next(packet for packet in sent.packets() if isinstance(packet, ModelPacket))
    transform = parse_transform(model.profile_data)
    known = len(transform.modes) - transform.reserved_modes
    one, other = transform.modes[0], sent.modes[0][0]

    def with_more(*modes: bytes) -> ModelPacket:
        missing = (b"",) * (transform.reserved_modes - len(modes))
        all_modes = transform.modes[:known] + modes + missing
        return replace(model, profile_data=serialise_transform(replace(transform, modes=all_modes)))

    drawn = FrameTextures(model)
    longer, _ = drawn.updated(with_more(one))
    # Three go on from models that another has gone on from: as where one is decoded again.
    added = ((), (one,), (one,), (other,), (one, other))
    updated = [drawn.updated(with_more(*modes))[0] for modes in added[2:]]
    coefficients = np.linspace(-3, 3, known + 2)
    for appearance, modes in zip((drawn, longer, *updated), added, strict=True):
        expected = FrameTextures(with_more(*modes))
        np.testing.assert_array_equal(
            appearance.synthesise(coefficients), expected.synthesise(coefficients)
        )


def test_frames_without_the_face_repeat_the_one_before_however_it_is_found_again(
    clip: Path, tmp_path: Path
) -> None:
    gaps = cv2.VideoWriter(
        str(tmp_path / "gaps.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), 25, (160, 120)
    )
    for index, picture in enumerate(read_frames(clip)):
        gaps.write(picture if index % 8 not in GAP else np.zeros_like(picture))
    gaps.release()
    with without_layers():
        sent = send(tmp_path / "gaps.mkv", frames=FEWER)
    assert sent.modes[0]
    repeated = index = 0
    for values in sent.targets:
        for place in range(len(values)):
            if place and (index + place) % 8 in GAP:
                np.testing.assert_array_equal(values[place], values[place - 1])
                repeated += 1
        index += len(values)
    assert index == FEWER and repeated > 10


def test_modes_are_reserved_for_later_frames(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # After a second of face the model is trained again only after another thousand.
    monkeypatch.setattr(
        "encoder.live_model.pacing.UNPACED", replace(UNPACED, updates={1.0: 0.6, 1001.0: 1.0})
    )
    copy = tmp_path / "clip.mkv"
    copy.write_bytes(clip.read_bytes())
    with without_layers():
        sent = send(copy, frames=FEWER)
    share = (FEWER / 25 - 1.0) / 1000
    assert 0 < len(sent.modes[1]) <= np.ceil(RESERVED_MODES * share**MODE_SPENDING_EXPONENT) == 2
