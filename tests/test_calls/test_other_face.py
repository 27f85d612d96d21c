"""Another face instead of the caller's: the other end sees it, and gets nothing of the caller."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import LIVE_MODEL_BYTES, without_layers
from videos import read_frames

from decoder.pipeline import DecodeOptions, decode
from encoder.calls.session_callbacks import SessionCallbacks
from encoder.calls.session_stats import SessionStats
from encoder.capture.video_source import open_source
from encoder.live_model.other_face import OtherFace, cut_to
from encoder.options import EncodeOptions
from encoder.pipeline import EncodeRun, encode_live
from protocol.call_file import CallReader, CallWriter
from protocol.model_packet import ModelPacket
from protocol.packets import FramePacket, LayerPacket, Packet, parse_packet
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError

FRAMES, PACKED = 44, 4


def blue_face(clip: Path) -> Picture:
    """Somebody whose skin is blue, in a larger and wider picture."""
    with open_source(str(clip)) as capture:
        _, picture = next(iter(capture))
    wide = cv2.copyMakeBorder(picture[..., ::-1], 0, 0, 30, 50, cv2.BORDER_REPLICATE)
    return np.asarray(cv2.resize(wide, None, fx=1.5, fy=1.5), np.uint8)


def call_of(
    clip: Path, folder: Path, is_shown: Callable[[int], bool], picture: Picture
) -> tuple[list[Packet], Array]:
    """The packets of a call, and by how much red exceeds blue in each decoded picture.

    is_shown: whether another face is shown once so many frames are encoded.
    """
    done = [0]

    def progress(count: int, total: int | None) -> None:
        done[0] = count

    other = OtherFace(picture, lambda: is_shown(done[0]))
    callbacks = SessionCallbacks(progress, lambda: False, other_face=other)
    path, shown = folder / "call.rzo", folder / "shown.mkv"
    options = EncodeOptions(
        str(clip), live=True, low_delay=True, model_bytes=LIVE_MODEL_BYTES, max_frames=FRAMES
    )
    with open_source(str(clip)) as capture, CallWriter(path) as sink, without_layers():
        encode_live(EncodeRun(options, capture, SessionStats(), callbacks), sink)
    with CallReader(path) as reader:
        packets = [parse_packet(data) for data in reader]
    decode(DecodeOptions(path, output=shown), lambda done, total: None, lambda: False)
    colours = np.array([frame.mean((0, 1)) for frame in read_frames(shown)])
    return packets, colours[:, 2] - colours[:, 0]


def test_the_other_end_sees_another_face_from_one_press_to_the_next(
    talking_clip: Path, tmp_path: Path
) -> None:
    on, off = 8, 22
    picture = blue_face(talking_clip)
    packets, redness = call_of(talking_clip, tmp_path, lambda done: on <= done < off, picture)
    assert redness[:on].min() > 5 and redness[-1] > 5
    is_blue = redness < -5
    first = int(np.flatnonzero(is_blue)[0])
    last = int(np.flatnonzero(is_blue)[-1])
    assert is_blue[first : last + 1].all() and on < first < off < last
    # From the press on nothing is sent but the other face, until it is switched off.
    sent = packets[: packets_until(packets, off)][packets_until(packets, on) :]
    looks = [each for each in sent if isinstance(each, ModelPacket | LayerPacket)]
    assert [type(each) for each in looks] == [ModelPacket]
    versions = [each.version for each in packets if isinstance(each, ModelPacket)]
    assert versions == list(range(len(versions)))


def packets_until(packets: list[Packet], frame: int) -> int:
    """How many packets are complete by a source frame."""
    sizes = [isinstance(packet, FramePacket) * PACKED for packet in packets]
    # The first one has one frame.
    return int(np.flatnonzero(np.cumsum(sizes) - PACKED + 1 > frame)[0])


def test_a_call_that_begins_with_another_face_never_shows_the_caller(
    talking_clip: Path, tmp_path: Path
) -> None:
    packets, redness = call_of(talking_clip, tmp_path, lambda done: True, blue_face(talking_clip))
    assert redness.max() < -5
    looks = [each for each in packets if isinstance(each, ModelPacket | LayerPacket)]
    assert [type(each) for each in looks] == [ModelPacket]
    # It moves as the caller does.
    values = {each.payload for each in packets if isinstance(each, FramePacket)}
    assert len(values) > 5


def test_a_picture_without_a_face_is_said(talking_clip: Path, tmp_path: Path) -> None:
    nobody = np.full((90, 160, 3), 128, np.uint8)
    with pytest.raises(UserError, match="no face is found"):
        call_of(talking_clip, tmp_path, lambda done: True, nobody)


@pytest.mark.parametrize("size", [(160, 120), (120, 160), (300, 100)])
def test_a_picture_is_cut_around_the_face_to_the_proportions_of_the_call(
    size: tuple[int, int],
) -> None:
    picture = np.zeros((200, 300, 3), np.uint8)
    picture[90:110, 240:260] = 255
    cut = cut_to(picture, np.array([250.0, 100.0]), size)
    assert cut.shape == (size[1], size[0], 3)
    assert cut.max() > 200
