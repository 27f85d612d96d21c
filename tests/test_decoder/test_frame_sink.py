"""Decoded pictures are unchanged in the files, whatever ends the recording."""

from fractions import Fraction
from io import BytesIO
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from decoder.sinks.frame_sink import ThreadedSink, open_sink
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError


def noise(count: int, width: int = 64, height: int = 48) -> list[Picture]:
    rng = np.random.default_rng(7)
    return [rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(count)]


def read(path: Path) -> tuple[list[Picture], float]:
    capture = cv2.VideoCapture(str(path))
    pictures = []
    while (answer := capture.read())[0]:
        pictures.append(np.asarray(answer[1], dtype=np.uint8))
    return pictures, capture.get(cv2.CAP_PROP_FPS)


def tags(path: Path) -> tuple[int, int, int, int]:
    """Matrix, range, primaries and transfer of a file, by their numbers in ITU-T H.273."""
    with av.open(str(path)) as container:
        context = container.streams.video[0].codec_context
        return (
            context.colorspace,
            context.color_range,
            context.color_primaries,
            context.color_trc,
        )


def bt709(picture: Picture) -> Array:
    """Y'CbCr, (3, height, width), 8 bits and limited range, by the equations of ITU-R BT.709."""
    blue, green, red = np.moveaxis(picture / 255, -1, 0)
    luma = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    chroma = [(blue - luma) / 1.8556, (red - luma) / 1.5748]
    return np.stack([16 + 219 * luma, *(128 + 224 * value for value in chroma)])


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_lossless_files_give_every_picture_back_bit_for_bit(tmp_path: Path, suffix: str) -> None:
    path, pictures = tmp_path / f"out{suffix}", noise(31)
    with open_sink(path, 64, 48, Fraction(25)) as sink:
        for picture in pictures:
            sink.write(picture)
    back, _ = read(path)
    assert len(back) == 31
    assert all(np.array_equal(a, b) for a, b in zip(pictures, back, strict=True))
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_bt709_is_tagged_and_its_planes_are_those_of_the_pictures(tmp_path: Path) -> None:
    path, pictures = tmp_path / "out.mkv", noise(3, 63, 47)
    with open_sink(path, 63, 47, Fraction(25), "bt709") as sink:
        for picture in pictures:
            sink.write(picture)
    assert tags(path) == (1, 1, 1, 1)
    with av.open(str(path)) as container:
        frames = list(container.decode(video=0))
    for frame, picture in zip(frames, pictures, strict=True):
        assert frame.format.name == "yuv444p"
        assert np.abs(frame.to_ndarray() - bt709(picture)).max() < 1


def test_bt709_is_read_back_to_the_pictures(tmp_path: Path) -> None:
    path, pictures = tmp_path / "out.mkv", noise(3)
    with open_sink(path, 64, 48, Fraction(25), "bt709") as sink:
        for picture in pictures:
            sink.write(picture)
    for back, picture in zip(read(path)[0], pictures, strict=True):
        assert np.abs(back.astype(int) - picture).max() <= 2


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".webm"])
@pytest.mark.parametrize("matrix", ["bt601", "bt709"])
def test_lossy_files_have_the_colours_of_either_matrix(
    tmp_path: Path, matrix: str, suffix: str
) -> None:
    path, red = tmp_path / f"out{suffix}", np.full((48, 64, 3), (40, 40, 200), np.uint8)
    with open_sink(path, 64, 48, Fraction(25), matrix) as sink:
        sink.write(red)
    assert (tags(path)[0] == 1) == (matrix == "bt709")
    assert np.abs(read(path)[0][0].astype(int) - red).max() <= 4


@pytest.mark.parametrize("matrix", ["bt601", "bt709"])
@pytest.mark.parametrize("size", [(64, 48), (63, 47)])
def test_lossy_files_are_read_back_as_bright_as_the_pictures(
    tmp_path: Path, matrix: str, size: tuple[int, int]
) -> None:
    """Of skin, which FFmpeg reads two grey levels darker than its luma says."""
    path, (width, height) = tmp_path / "out.mp4", size
    shade = np.linspace(0.6, 1.2, width)[None, :, None] * np.linspace(0.8, 1, height)[:, None, None]
    skin = (shade * (95.0, 120.0, 170.0)).astype(np.uint8)
    with open_sink(path, width, height, Fraction(25), matrix) as sink:
        sink.write(skin)
    error = (read(path)[0][0].astype(float) - skin) @ (0.114, 0.587, 0.299)
    assert abs(error.mean()) < 0.3 and (error**2).mean() < 1


def test_files_without_a_tag_are_rgb(tmp_path: Path) -> None:
    for name, matrix in (("a.mkv", "bt601"), ("b.avi", "bt601"), ("c.avi", "bt709")):
        (picture,) = noise(1)
        with open_sink(tmp_path / name, 64, 48, Fraction(25), matrix) as sink:
            sink.write(picture)
        assert tags(tmp_path / name)[0] != 1
        assert np.array_equal(read(tmp_path / name)[0][0], picture)


@pytest.mark.parametrize("suffix", [".mkv", ".avi", ".mp4", ".mov", ".webm"])
@pytest.mark.parametrize("fps", ["25", "30000/1001", "24000/1001", "15", "25/2", "60"])
def test_a_video_states_the_exact_frame_rate(tmp_path: Path, fps: str, suffix: str) -> None:
    path = tmp_path / f"out{suffix}"
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


@pytest.mark.parametrize("fps", ["120000/1001", "1000", "1/1000"])
def test_mp4_states_any_rate(tmp_path: Path, fps: str) -> None:
    path = tmp_path / "out.mp4"
    with open_sink(path, 64, 48, Fraction(fps)) as sink:
        for picture in noise(5):
            sink.write(picture)
    back, rate = read(path)
    assert len(back) == 5 and rate == pytest.approx(float(Fraction(fps)), rel=1e-5)


@pytest.mark.parametrize("suffix", [".mkv", ".avi", ".mp4", ".mov", ".webm"])
def test_odd_pictures_keep_their_size(tmp_path: Path, suffix: str) -> None:
    path, pictures = tmp_path / f"out{suffix}", noise(2, 63, 47)
    with open_sink(path, 63, 47, Fraction(25)) as sink:
        for picture in pictures:
            sink.write(picture)
    back, _ = read(path)
    assert [picture.shape for picture in back] == [(47, 63, 3)] * 2
    assert suffix in (".mp4", ".mov", ".webm") or np.array_equal(back[1], pictures[1])


def test_a_picture_need_not_lie_in_one_piece(tmp_path: Path) -> None:
    path, (picture,) = tmp_path / "out.mkv", noise(1)
    with open_sink(path, 64, 48, Fraction(25)) as sink:
        sink.write(picture[::-1, :, ::-1])
    assert np.array_equal(read(path)[0][0], picture[::-1, :, ::-1])


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


@pytest.mark.parametrize("name", ["out.mkv", "out.mp4"])
def test_a_disk_that_fills_up_is_said_in_one_line(tmp_path: Path, name: str) -> None:
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, hard))
    try:
        with (
            pytest.raises(UserError, match=r"cannot write .*File too large"),
            open_sink(tmp_path / name, 64, 48, Fraction(25)) as sink,
        ):
            for picture in noise(40):
                sink.write(picture)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    # What is torn does not stand where something whole is expected.
    assert [file.name for file in tmp_path.iterdir()] == [name.replace(".", ".part.")]


def test_a_picture_of_another_size_is_refused(tmp_path: Path) -> None:
    with (
        open_sink(tmp_path / "out.mkv", 64, 48, Fraction(25)) as sink,
        pytest.raises(ValueError, match="expected"),
    ):
        sink.write(noise(1, 62, 48)[0])


def test_background_sink_writes_everything_in_order(tmp_path: Path) -> None:
    path, pictures = tmp_path / "out.mkv", noise(25)
    with ThreadedSink(open_sink(path, 64, 48, Fraction(25))) as sink:
        for picture in pictures:
            sink.write(picture)
    assert all(np.array_equal(a, b) for a, b in zip(pictures, read(path)[0], strict=True))


def test_background_sink_is_finished_when_interrupted(tmp_path: Path) -> None:
    path = tmp_path / "out.mkv"
    with (
        pytest.raises(KeyboardInterrupt),
        ThreadedSink(open_sink(path, 64, 48, Fraction(25))) as sink,
    ):
        for picture in noise(11):
            sink.write(picture)
        raise KeyboardInterrupt
    assert len(read(path)[0]) == 11


def test_a_threaded_sink_passes_errors_on_and_closes(tmp_path: Path) -> None:
    sink = ThreadedSink(open_sink(tmp_path / "out.mkv", 64, 48, Fraction(25)))
    sink.write(noise(1)[0])
    sink.write(noise(1, 62, 48)[0])
    with pytest.raises(ValueError, match="expected"):
        sink.close()
    sink.close()
    assert len(read(tmp_path / "out.mkv")[0]) == 1


def test_an_unknown_matrix_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="matrix is 'bt2020'"):
        open_sink(tmp_path / "a.mkv", 16, 16, Fraction(25), "bt2020")
    assert not list(tmp_path.iterdir())


def test_an_older_video_is_kept_until_the_new_one_is_complete(tmp_path: Path) -> None:
    path, picture = tmp_path / "out.mkv", np.zeros((48, 64, 3), np.uint8)
    path.write_bytes(b"complete")
    with pytest.raises(KeyboardInterrupt), open_sink(path, 64, 48, Fraction(25)) as sink:
        sink.write(picture)
        raise KeyboardInterrupt
    assert path.read_bytes() == b"complete"
    with ThreadedSink(open_sink(path, 64, 48, Fraction(25))) as sink:
        sink.write(picture)
        aside = sink.mark_incomplete()
    assert aside is not None and aside.exists() and path.read_bytes() == b"complete"
    with open_sink(path, 64, 48, Fraction(25)) as sink:
        sink.write(picture)
    assert path.read_bytes() != b"complete" and not aside.exists()


def test_images_on_a_full_disk_are_said_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    resource = pytest.importorskip("resource")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))
    try:
        with (
            pytest.raises(UserError, match=r"cannot write .*f0\.png: File too large"),
            open_sink(tmp_path / "f%d.png", 64, 48, Fraction(25)) as sink,
        ):
            sink.write(next(iter(noise(1))))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert not capfd.readouterr().err


def test_a_video_where_no_file_can_be_made_is_said_in_one_line() -> None:
    proc = Path("/proc")
    if not proc.is_dir():
        pytest.skip("no file system here that takes no files")
    with pytest.raises(UserError, match=r"cannot write /proc/out\.mkv: [^/]*$"):
        open_sink(proc / "out.mkv", 64, 48, Fraction(25))


@pytest.mark.parametrize(
    ("name", "aspect"),
    [
        ("o.mkv", Fraction(2)),
        ("o.mkv", Fraction(1, 2)),
        ("o.mp4", Fraction(16, 11)),
        ("o.mov", Fraction(12, 11)),
    ],
)
def test_the_sample_aspect_ratio_is_stated(tmp_path: Path, name: str, aspect: Fraction) -> None:
    size, rate = (64, 48), Fraction(25)
    path = tmp_path / name
    with open_sink(path, *size, rate, sample_aspect=aspect, sound_rate_hz=8000) as sink:
        for value in (50, 200):
            sink.write(np.full((48, 64, 3), value, np.uint8))
        sink.write_sound(np.zeros(640, np.int16))
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        assert stream.sample_aspect_ratio == aspect and (stream.width, stream.height) == size
        assert [frame.rotation for frame in container.decode(stream)] == [0, 0]


def test_a_stream_states_the_sample_aspect_ratio() -> None:
    stream = BytesIO()
    open_sink(stream, 64, 48, Fraction(25), sample_aspect=Fraction(16, 11))
    assert b" A16:11 " in stream.getvalue()
