"""A camera by the clock: late frames are left out, early ones too, and time goes on."""

import time
from fractions import Fraction
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np
import pytest

from decoder.sinks.frame_sink import open_sink
from encoder.capture.frame_times import FrameTimes
from encoder.capture.live_capture import (
    NO_PICTURE,
    FrameMailbox,
    LiveCapture,
    by_arrival,
    read_camera,
)
from encoder.capture.picture_size import MAX_PICTURE_PX, reduced
from encoder.capture.video_source import Capture, open_source
from shared_model.arrays import Picture
from shared_model.errors import UserError

FPS = Fraction(25)


def picture(value: int, height: int = 4, width: int = 6) -> Picture:
    return np.full((height, width, 3), value, np.uint8)


def indices(times_s: list[float]) -> list[int]:
    """The indices of frames that are all taken, by the times at which they were."""
    mailbox = FrameMailbox(FPS)
    mailbox.put(picture(0), 0.0)
    capture, found = LiveCapture("camera", mailbox, FPS), list[int]()
    mailbox.put(picture(0), times_s[0])
    for index, _ in capture:
        found.append(index)
        times_s = times_s[1:]
        if not times_s:
            break
        mailbox.put(picture(0), times_s[0])
    return found


def test_frames_have_the_index_of_their_time() -> None:
    assert indices([3.0, 3.04, 3.08, 3.2, 3.24]) == [0, 1, 2, 5, 6]


def test_a_camera_of_half_the_rate_leaves_out_every_other_index() -> None:
    assert indices([0.08 * i for i in range(5)]) == [0, 2, 4, 6, 8]


def test_jitter_neither_repeats_nor_leaves_out_an_index() -> None:
    assert indices([0, 0.05, 0.07, 0.13, 0.15]) == [0, 1, 2, 3, 4]


def test_the_newest_frame_is_taken_and_after_closing_none() -> None:
    mailbox = FrameMailbox(FPS)
    for value in (1, 2):
        mailbox.put(picture(value), float(value))
    taken = mailbox.take()
    assert taken is not None and taken[0] == 2.0 and taken[1][0, 0, 0] == 2
    mailbox.close()
    assert mailbox.take() is None


def test_who_waits_gets_the_error_that_ends_the_camera() -> None:
    mailbox = FrameMailbox(FPS)
    mailbox.close(UserError("unplugged"))
    with pytest.raises(UserError, match="unplugged"):
        LiveCapture("camera", mailbox, FPS)


def test_while_the_camera_is_off_there_are_frames_without_pictures() -> None:
    mailbox = FrameMailbox(FPS)
    mailbox.put(picture(1), 0.0)
    capture = LiveCapture("camera", mailbox, FPS)
    mailbox.switch(on=False)
    frames = iter(capture)
    assert all(next(frames)[1] is NO_PICTURE for _ in range(3))
    mailbox.switch(on=True)
    mailbox.put(picture(7), 1e9)
    assert next(frames)[1][0, 0, 0] == 7


def test_a_camera_that_gives_nothing_any_more_is_taken_as_off() -> None:
    now_s = iter([0.0, *[2.0] * 9])
    mailbox = FrameMailbox(FPS, lambda: next(now_s))
    mailbox.put(picture(1), 0.0)
    first, taken = mailbox.take(), mailbox.take()
    assert first is not None and first[1].size
    assert taken is not None and taken[1] is NO_PICTURE


def test_frames_of_another_size_are_brought_to_that_of_the_first() -> None:
    mailbox = FrameMailbox(FPS)
    mailbox.put(picture(1), 0.0)
    capture = LiveCapture("camera", mailbox, FPS)
    mailbox.put(picture(9, 8, 12), 0.1)
    assert next(iter(capture))[1].shape == (4, 6, 3)


def test_a_file_is_a_camera_that_begins_again_at_its_end(tmp_path: Path) -> None:
    path = tmp_path / "clip.mkv"
    with open_sink(path, 16, 16, Fraction(100)) as sink:
        for value in (10, 200):
            sink.write(picture(value, 16, 16))
    put = list[tuple[int, float]]()

    class NotingMailbox(FrameMailbox):
        """Notes what is put in: on a busy host not all is taken."""

        def put(self, picture: Picture, time_s: float) -> None:
            put.append((int(picture[0, 0, 0]), time_s))
            if len(put) == 6:
                self.close()

    with open_source(str(path)) as opened:
        mailbox = NotingMailbox(Fraction(100))
        read_camera(str(path), mailbox, opened, repeat=True).join()
    assert [value for value, _ in put] == [10, 200] * 3
    times_s = [time_s for _, time_s in put]
    assert times_s == sorted(times_s)


def test_an_error_of_a_camera_is_raised_by_who_takes_its_frames(tmp_path: Path) -> None:
    path = tmp_path / "0.png"
    cv2.imwrite(str(path), picture(1))
    mailbox = FrameMailbox(FPS)

    def unplugged(start_s: float) -> None:
        raise RuntimeError("unplugged")

    with open_source(str(path.with_name("%d.png"))) as opened:
        read_camera(str(path), mailbox, opened, repeat=False, on_start=unplugged).join()
    with pytest.raises(RuntimeError, match="unplugged"):
        mailbox.take()


def test_large_pictures_are_reduced_and_small_ones_stay() -> None:
    large = reduced(picture(1, 720, 1280))
    assert large.shape[0] * large.shape[1] <= MAX_PICTURE_PX * 1.01
    assert large.shape[0] % 2 == large.shape[1] % 2 == 0
    small = picture(1)
    assert reduced(small) is small


def test_a_picture_of_another_shape_is_not_stretched() -> None:
    mailbox = FrameMailbox(FPS)
    mailbox.put(picture(0, 48, 96), 0.0)
    capture = LiveCapture("camera", mailbox, FPS)
    mailbox.put(picture(200, 96, 48), 0.0)
    _, upright = next(iter(capture))
    assert upright.shape == (48, 96, 3)
    assert (upright[:, 36:60] == 200).all()
    assert not upright[:, :35].any() and not upright[:, 61:].any()


def test_frames_of_a_live_source_are_counted_by_their_arrival() -> None:
    """Ten pictures, one every 120 ms, of a source that states 25 a second."""

    class SlowReader:
        count = 0
        notes: ClassVar[list[str]] = []

        def read(self) -> Picture | None:
            self.count += 1
            if self.count > 1:
                time.sleep(0.12)
            return None if self.count > 11 else picture(self.count)

        def close(self) -> None:
            pass

    slow = Capture("camera", SlowReader(), FrameTimes(FPS), None, is_live=True)
    with by_arrival(slow) as capture:
        indices = [index for index, _ in capture]
    assert 6 <= len(indices) <= 11
    assert indices[-1] - indices[0] == pytest.approx(3 * (len(indices) - 1), abs=4)
