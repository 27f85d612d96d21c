"""Which frames of a source are learned from."""

import numpy as np
import pytest

from encoder.learning.frame_sampler import DENSE_FRAMES, TRAINING_FRAMES, UniformSubsampler
from shared_model.arrays import Picture


@pytest.mark.parametrize("count", [1, 10, TRAINING_FRAMES, 2 * TRAINING_FRAMES, 5000])
def test_a_sample_is_spread_over_a_source_of_any_length(count: int) -> None:
    sampler, made = UniformSubsampler[Picture](), []
    picture: Picture = np.zeros((1, 1, 3), np.uint8)

    def window() -> Picture:
        made.append(1)
        return picture

    for number in range(count):
        sampler.offer(number, window)
    numbers = [number for number, _ in sampler.frames]
    assert min(count, TRAINING_FRAMES) <= len(numbers) < 2 * TRAINING_FRAMES
    assert numbers[0] == 0 and numbers[-1] >= 0.97 * (count - 1) - 1
    assert len(set(np.diff(numbers))) <= 1
    assert len(made) < 15 * TRAINING_FRAMES


@pytest.mark.parametrize(
    ("count", "kept", "stride"),
    [(DENSE_FRAMES - 1, DENSE_FRAMES - 1, 1), (DENSE_FRAMES, DENSE_FRAMES // 2, 2), (120, 60, 2)],
)
def test_no_two_frames_in_a_row_are_learned_from_unless_there_are_few(
    count: int, kept: int, stride: int
) -> None:
    sampler = UniformSubsampler[int](TRAINING_FRAMES, DENSE_FRAMES)
    for number in range(count):
        sampler.offer(number, lambda number=number: number)  # type: ignore[misc]
    numbers = [number for number, _ in sampler.frames]
    assert numbers == list(range(0, stride * kept, stride))
