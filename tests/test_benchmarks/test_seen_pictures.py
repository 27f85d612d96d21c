"""What a page shows is compared with the frame of the clip that it is."""

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="needs aiohttp: pip install '.[call]'")

from benchmarks.call_delay.seen_pictures import first_frame


def test_the_frame_of_a_repeated_clip_is_found_by_the_pictures() -> None:
    rng = np.random.default_rng(1)
    clip = list(rng.integers(0, 256, (40, 12, 16, 3), dtype=np.uint8))
    noise = rng.integers(-20, 21, (6, 12, 16, 3))
    indices = [3, 28, 55, 81, 104, 260]
    seen = [
        (index, np.clip(clip[(17 + index) % 40].astype(int) + each, 0, 255).astype(np.uint8))
        for index, each in zip(indices, noise, strict=True)
    ]
    assert first_frame(clip, seen) == 17
