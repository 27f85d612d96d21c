"""Other codecs on the same pictures."""

import os
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from loopback.curves.curve_bench import rivals_named
from loopback.curves.rivals import (
    RIVALS,
    Rival,
    RivalSetting,
    code,
    decoded,
    scaled_size,
    shrunk,
)
from loopback.quality.psnr import psnr_db, squared_error
from shared_model.arrays import Picture
from shared_model.errors import UserError

SIZE = 160, 128
FPS = Fraction(25)


def moving(count: int = 13) -> list[Picture]:
    """A soft pattern that moves."""
    y, x = np.mgrid[: SIZE[1], : SIZE[0]]
    pictures = []
    for number in range(count):
        wave = np.sin((x + 2 * number) / 9) + np.cos(y / 7)
        grey = np.clip(128 + 50 * wave, 0, 255).astype(np.uint8)
        pictures.append(np.ascontiguousarray(np.repeat(grey[..., None], 3, 2)))
    return pictures


@pytest.fixture(params=list(RIVALS))
def rival(request: pytest.FixtureRequest) -> Rival:
    found = RIVALS[request.param]
    if not found.is_installed:
        pytest.skip(f"this PyAV has no {found.name}")
    return found


def psnr(originals: list[Picture], copies: list[Picture]) -> float:
    pairs = zip(originals, copies, strict=True)
    return float(np.mean([psnr_db(squared_error(*pair)) for pair in pairs]))


@pytest.mark.parametrize("is_realtime", [False, True])
def test_more_bits_give_more_quality(rival: Rival, is_realtime: bool) -> None:
    pictures = moving()
    found = []
    for quality in (rival.qualities[0], rival.qualities[-1]):
        packets = code(rival, RivalSetting(quality, is_realtime=is_realtime), pictures, FPS)
        copies = list(decoded(rival, packets, 1, SIZE))
        assert len(copies) == len(pictures)
        found.append((sum(packet.size for packet in packets), psnr(pictures, copies)))
    (few, coarse), (many, fine) = found
    assert few < many and coarse + 1 < fine and fine > 30


def test_only_the_first_picture_is_a_key_frame(rival: Rival) -> None:
    packets = code(rival, RivalSetting(rival.qualities[2]), moving(), FPS)
    assert [packet.is_keyframe for packet in packets] == [True] + [False] * (len(packets) - 1)


def test_smaller_pictures_at_half_the_rate_come_back_in_size_and_number(rival: Rival) -> None:
    pictures = moving(12)
    size = scaled_size(SIZE, 0.5)
    assert size == (80, 64)
    setting = RivalSetting(rival.qualities[3], 0.5, 2)
    packets = code(rival, setting, shrunk(pictures[::2], size), FPS)
    copies = list(decoded(rival, packets, 2, SIZE))
    assert len(copies) == 12 and copies[0].shape == pictures[0].shape
    assert np.array_equal(copies[0], copies[1]) and not np.array_equal(copies[1], copies[2])
    assert psnr(pictures[::2], copies[::2]) > 25


def test_who_has_made_a_stream_is_not_counted() -> None:
    packets = code(RIVALS["x264"], RivalSetting(51), moving(3), FPS)
    assert b"x264" not in bytes(packets[0])


def test_sizes_are_even_and_not_too_small() -> None:
    assert scaled_size((175, 143), 1) == (176, 144) or scaled_size((175, 143), 1) == (174, 142)
    assert scaled_size((176, 144), 0.25) is None


def test_a_rival_that_is_not_known_is_the_users_mistake() -> None:
    with pytest.raises(UserError, match="h261 is no rival; there are svtav1"):
        rivals_named(["h261"])


@pytest.mark.skipif(not hasattr(os, "sched_getscheduler"), reason="needs Linux")
def test_a_rival_leaves_the_scheduling_of_the_program_as_it_was(rival: Rival) -> None:
    def policies() -> set[int]:
        return {os.sched_getscheduler(int(each.name)) for each in Path("/proc/self/task").iterdir()}

    before = policies()
    assert code(rival, RivalSetting(rival.qualities[0]), moving(4), FPS)
    assert policies() == before
