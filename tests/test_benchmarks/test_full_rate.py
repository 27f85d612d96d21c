"""The script that draws what the tracker knows: every frame, and light only where the face is."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.full_rate import main, relit
from encoder.capture.video_source import open_source
from shared_model.errors import UserError


def test_every_frame_is_drawn_and_light_brings_it_nearer(carphone: Path, tmp_path: Path) -> None:
    left = []
    for name, options in (("plain.mkv", list[str]()), ("lit.mkv", ["--light"])):
        main([str(carphone), str(tmp_path / name), "--frames", "4", *options])
        with open_source(str(carphone)) as source, open_source(str(tmp_path / name)) as video:
            assert (video.width, video.height) == (source.width, source.height)
            copies = [frame for _, frame in video]
            originals = [frame for _, frame in source][: len(copies)]
        assert len(copies) == 4
        left.append(np.mean((np.array(copies, float) - np.array(originals)) ** 2))
    assert left[1] < left[0]


def test_light_is_found_and_stays_on_the_face() -> None:
    random = np.random.default_rng(4)
    drawn = random.integers(60, 180, (40, 60, 3)).astype(np.uint8)
    down, across = np.mgrid[:40, :60]
    gain = 1.05 + 0.004 * across - 0.003 * down
    original = np.rint(gain[..., None] * drawn + 9).astype(np.uint8)
    face = np.zeros((40, 60), bool)
    face[5:25, 5:25] = True
    found = relit(drawn, original, face)
    assert np.abs(found[face].astype(float) - original[face]).max() <= 2
    np.testing.assert_array_equal(found[:, 40:], drawn[:, 40:])


def test_a_source_that_begins_without_a_face_is_refused(
    networks: Path, noise: Path, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match="begins without a face"):
        main([str(noise), str(tmp_path / "out.mkv")])
