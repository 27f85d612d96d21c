"""Decoded pictures arrive in the files as they were, whatever ends the recording."""

from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from decoder.sink import Background, open_sink
from shared_model.errors import UserError

Picture = NDArray[np.uint8]


def noise(count: int, width: int = 64, height: int = 48) -> list[Picture]:
    rng = np.random.default_rng(7)
    return [rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(count)]


def read(path: Path) -> tuple[list[Picture], float]:
    capture = cv2.VideoCapture(str(path))
    pictures = []
    while (answer := capture.read())[0]:
        pictures.append(np.asarray(answer[1], dtype=np.uint8))
    return pictures, capture.get(cv2.CAP_PROP_FPS)


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_ffv1_gives_every_picture_back_bit_for_bit(tmp_path: Path, suffix: str) -> None:
    path, pictures = tmp_path / f"out{suffix}", noise(31)
    with open_sink(path, 64, 48, Fraction(25)) as sink:
        for picture in pictures:
            sink.write(picture)
    back, _ = read(path)
    assert len(back) == 31
    assert all(np.array_equal(a, b) for a, b in zip(pictures, back, strict=True))
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("fps", ["25", "30000/1001", "24000/1001", "15", "25/2", "60"])
def test_matroska_states_the_exact_frame_rate(tmp_path: Path, fps: str) -> None:
    path = tmp_path / "out.mkv"
    with open_sink(path, 64, 48, Fraction(fps)) as sink:
        for picture in noise(5):
            sink.write(picture)
    back, rate = read(path)
    assert len(back) == 5 and rate == pytest.approx(float(Fraction(fps)), rel=1e-9)


def test_mp4_keeps_count_and_size(tmp_path: Path) -> None:
    path = tmp_path / "out.mp4"
    with open_sink(path, 64, 48, Fraction(25)) as sink:
        for picture in noise(9):
            sink.write(picture)
    back, _ = read(path)
    assert len(back) == 9 and back[0].shape == (48, 64, 3)


def test_image_sequence_is_numbered_like_the_source_and_exact(tmp_path: Path) -> None:
    pictures = noise(3, 63, 47)
    with open_sink(tmp_path / "f%04d.png", 63, 47, Fraction(25)) as sink:
        for picture in pictures:
            sink.write(picture)
    back, _ = read(tmp_path / "f%04d.png")
    assert sorted(file.name for file in tmp_path.iterdir()) == [f"f{k:04d}.png" for k in range(3)]
    assert all(np.array_equal(a, b) for a, b in zip(pictures, back, strict=True))


def test_odd_video_repeats_its_edge_and_keeps_the_rest(tmp_path: Path) -> None:
    path, pictures = tmp_path / "out.mkv", noise(2, 63, 47)
    with open_sink(path, 63, 47, Fraction(25)) as sink:
        for picture in pictures:
            sink.write(picture)
    back, _ = read(path)
    assert back[0].shape == (48, 64, 3)
    assert np.array_equal(back[1][:47, :63], pictures[1])


def test_interrupted_recording_is_finished_and_plays(tmp_path: Path) -> None:
    path = tmp_path / "out.mkv"
    with pytest.raises(KeyboardInterrupt), open_sink(path, 64, 48, Fraction(25)) as sink:
        for picture in noise(4):
            sink.write(picture)
        raise KeyboardInterrupt
    assert len(read(path)[0]) == 4
    assert [file.name for file in tmp_path.iterdir()] == ["out.mkv"]


def test_nothing_is_left_behind_when_nothing_was_written(tmp_path: Path) -> None:
    with open_sink(tmp_path / "out.mkv", 64, 48, Fraction(25)):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["out.txt", "out", "f%d.xyz", "f%s%s.png", "none/out.mkv"])
def test_an_impossible_output_is_the_users_error(tmp_path: Path, name: str) -> None:
    with pytest.raises(UserError, match="cannot write"):
        open_sink(tmp_path / name, 64, 48, Fraction(25))


def test_a_picture_of_another_size_is_refused(tmp_path: Path) -> None:
    with (
        open_sink(tmp_path / "out.mkv", 64, 48, Fraction(25)) as sink,
        pytest.raises(ValueError, match="expected"),
    ):
        sink.write(noise(1, 62, 48)[0])


def test_background_sink_writes_everything_in_order(tmp_path: Path) -> None:
    path, pictures = tmp_path / "out.mkv", noise(25)
    with Background(open_sink(path, 64, 48, Fraction(25))) as sink:
        for picture in pictures:
            sink.write(picture)
    assert all(np.array_equal(a, b) for a, b in zip(pictures, read(path)[0], strict=True))


def test_background_sink_is_finished_when_interrupted(tmp_path: Path) -> None:
    path = tmp_path / "out.mkv"
    with (
        pytest.raises(KeyboardInterrupt),
        Background(open_sink(path, 64, 48, Fraction(25))) as sink,
    ):
        for picture in noise(11):
            sink.write(picture)
        raise KeyboardInterrupt
    assert len(read(path)[0]) == 11


def test_background_sink_passes_errors_on_and_still_closes(tmp_path: Path) -> None:
    sink = Background(open_sink(tmp_path / "out.mkv", 64, 48, Fraction(25)))
    sink.write(noise(1)[0])
    sink.write(noise(1, 62, 48)[0])
    with pytest.raises(ValueError, match="expected"):
        sink.close()
    sink.close()
    assert len(read(tmp_path / "out.mkv")[0]) == 1
