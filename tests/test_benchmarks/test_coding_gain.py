"""The coding gain table: every row codes the same values, more cheaply from step to step."""

from itertools import pairwise

import numpy as np
import pytest

from benchmarks.coding_gain import (
    ROWS,
    bps_by_row,
    interpolated_bps,
    markdown,
    optimised,
    predicted,
)
from benchmarks.fitted_clip import FittedClip
from encoder.coding.transform import design_transform, project
from protocol.frames.frame_transform import GEOMETRY_SIZE


@pytest.fixture(scope="module")
def clip() -> FittedClip:
    """Seven seconds of values with three sources of variation."""
    rng = np.random.default_rng(5)
    d, count = GEOMETRY_SIZE + 2, 180
    sources = np.zeros((count, 3))
    for t in range(1, count):
        sources[t] = 0.95 * sources[t - 1] + rng.normal(size=3)
    vectors = sources @ rng.normal(size=(3, d)) * 0.3 + rng.normal(size=(count, d)) * 0.02
    distortion = np.diag(rng.uniform(50, 500, d))
    transform = design_transform(vectors, distortion, (b"one", b"two"), 8)
    return FittedClip(vectors, distortion, transform, project(transform, vectors, distortion), 25.0)


def test_steps_save_bits(clip: FittedClip) -> None:
    found = bps_by_row(clip, 4.0)
    assert list(found) == list(ROWS)
    bits = [found[row] for row in ROWS]
    # Steady as these values are, contexts have nothing to adapt to.
    assert all(after < 1.03 * before for before, after in pairwise(bits[:-1]))
    assert bits[-2] < bits[0] / 5
    # What is sent in the end is whole bytes.
    assert bits[-2] < bits[-1] < 1.4 * bits[-2]


def test_finer_steps_cost_more_and_distort_less(clip: FittedClip) -> None:
    for coder in (predicted, optimised):
        coarse, fine = coder(clip, 12), coder(clip, 4)
        assert fine.distortion < coarse.distortion
        assert all(fine.bps[row] > coarse.bps[row] for row in fine.bps)
        halfway = interpolated_bps([coarse, fine], np.sqrt(fine.distortion * coarse.distortion))
        assert all(coarse.bps[row] < halfway[row] < fine.bps[row] for row in fine.bps)
        assert all(np.isnan(bps) for bps in interpolated_bps([coarse, fine], 1e9).values())


def test_the_table_says_what_each_row_saves() -> None:
    columns = {"a": {row: 1000.0 / 2**n for n, row in enumerate(ROWS)}}
    lines = markdown(columns).splitlines()
    assert len(lines) == 2 + len(ROWS)
    assert lines[2].endswith("| 1000 |  |") and lines[3].endswith("| 500 | 50 % |")
