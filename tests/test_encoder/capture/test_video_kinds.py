"""Kinds of video files that people have: one test each, on a file that it makes."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import cast

import av
import numpy as np
import pytest
from av.codec.context import Flags
from av.stream import Disposition
from av.video.reformatter import ColorPrimaries, ColorRange, Colorspace, ColorTrc
from av.video.stream import VideoStream

from encoder.capture.spooled_pipe import spooled
from encoder.capture.time_stamps import ordered_time_stamps
from encoder.capture.tone_mapping import ToneMapper
from encoder.capture.video_source import Capture, open_source
from shared_model.arrays import Picture
from shared_model.errors import UserError

SIZE = 64, 48


def ramp(number: int, width: int = SIZE[0], height: int = SIZE[1]) -> Picture:
    """A picture (height, width, 3) RGB that is smooth, coloured, not symmetric, and different."""
    y, x = np.mgrid[:height, :width] / (height + width)
    red, green = 40 + 300 * x, 60 + 200 * y
    return np.dstack([red, green, np.full_like(x, 40 + 6 * (number % 30))]).astype(np.uint8)


def write(
    path: Path,
    pictures: Sequence[Picture],
    codec: str = "ffv1",
    pixels: str = "yuv444p",
    times: Sequence[int] | None = None,
    rate: int = 25,
    options: dict[str, str] | None = None,
) -> None:
    """A video of RGB pictures.  times: of each, in 1 / 1000 s; None: evenly spaced."""
    with av.open(str(path), "w") as container:
        stream = cast(VideoStream, container.add_stream(codec, rate=rate, options=options or {}))
        stream.height, stream.width = pictures[0].shape[:2]
        stream.pix_fmt = pixels
        if times is not None:
            stream.codec_context.time_base = Fraction(1, 1000)
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format=pixels)
            if times is not None:
                frame.pts, frame.time_base = times[number], Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def read(path: Path | str) -> tuple[list[Picture], Capture]:
    """All frames, RGB, and the closed source."""
    with open_source(str(path)) as capture:
        return [frame[..., ::-1] for _, frame in capture], capture


def assert_like(found: Sequence[Picture], expected: Sequence[Picture], tolerance: float) -> None:
    assert len(found) == len(expected)
    for picture, truth in zip(found, expected, strict=True):
        assert picture.shape == truth.shape
        assert np.abs(picture.astype(float) - truth).mean() < tolerance


PICTURES = [ramp(n) for n in range(8)]


@pytest.mark.parametrize(
    ("codec", "pixels"),
    [
        ("ffv1", "yuv420p10le"),
        ("ffv1", "yuv422p10le"),
        ("ffv1", "gbrp10le"),
        ("ffv1", "yuva444p"),
        ("mjpeg", "yuvj444p"),
        ("libx264", "yuv420p"),
        ("libx265", "yuv420p10le"),
        ("libvpx-vp9", "yuv420p"),
    ],
)
def test_deep_rgb_transparent_and_full_range_pictures_keep_their_colours(
    tmp_path: Path, codec: str, pixels: str
) -> None:
    options = {"crf": "5"} if codec.startswith("lib") else {}
    write(tmp_path / "v.mkv", PICTURES, codec, pixels, options=options)
    found, capture = read(tmp_path / "v.mkv")
    assert_like(found, PICTURES, 6)
    assert capture.notes == []


def test_pictures_without_a_luma_are_read(tmp_path: Path) -> None:
    write(tmp_path / "v.avi", PICTURES, "utvideo", "gbrp")
    assert_like(read(tmp_path / "v.avi")[0], PICTURES, 1)


def test_transparent_pictures_are_read(tmp_path: Path) -> None:
    write(tmp_path / "v.mov", PICTURES, "png", "rgba")
    assert_like(read(tmp_path / "v.mov")[0], PICTURES, 1)


def test_grey_pictures_are_grey(tmp_path: Path) -> None:
    write(tmp_path / "v.mkv", PICTURES, pixels="gray")
    found, _ = read(tmp_path / "v.mkv")
    assert len(found) == 8
    for picture, truth in zip(found, PICTURES, strict=True):
        assert np.ptp(picture, axis=2).max() <= 1
        assert np.abs(picture.mean() - truth @ [0.299, 0.587, 0.114]).mean() < 20


def test_a_range_that_is_tagged_as_full_is_not_stretched(tmp_path: Path) -> None:
    path = tmp_path / "v.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv444p"
        stream.codec_context.color_range = ColorRange.JPEG
        grey = np.full((3, SIZE[1], SIZE[0]), 128, np.uint8)
        grey[0] = 240
        frame = av.VideoFrame.from_ndarray(grey, format="yuv444p")
        frame.color_range = ColorRange.JPEG
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    assert np.abs(read(path)[0][0].astype(int) - 240).max() <= 1


@pytest.mark.parametrize("size", [(63, 47), (33, 64), (64, 33), (35, 35)])
def test_odd_sizes_stay(tmp_path: Path, size: tuple[int, int]) -> None:
    pictures = [ramp(n, *size) for n in range(3)]
    write(tmp_path / "v.mkv", pictures, pixels="yuv420p")
    assert_like(read(tmp_path / "v.mkv")[0], pictures, 3)


def test_frames_that_are_coded_in_another_order_come_in_theirs(tmp_path: Path) -> None:
    pictures = [ramp(n) for n in range(20)]
    for suffix in ("mkv", "mp4", "ts"):
        path = tmp_path / f"v.{suffix}"
        write(path, pictures, "libx264", "yuv444p", options={"bf": "3", "crf": "5"})
        with av.open(str(path)) as container:
            stamps = [packet.pts or 0 for packet in container.demux(video=0) if packet.size]
        assert any(b < a for a, b in pairwise(stamps)), "no frame is coded in another order"
        found, capture = read(path)
        assert_like(found, pictures, 4)
        assert not capture.times.ticks and capture.notes == []


def test_gif_is_read(tmp_path: Path) -> None:
    write(tmp_path / "v.gif", PICTURES, "gif", "rgb8", rate=10)
    found, capture = read(tmp_path / "v.gif")
    assert len(found) == 8 and capture.fps == 10
    assert_like(found[:1], PICTURES[:1], 30)


@pytest.mark.parametrize(("transfer", "name"), [(16, "PQ"), (18, "HLG")])
def test_high_dynamic_range_is_tone_mapped_and_said(
    tmp_path: Path, transfer: int, name: str
) -> None:
    path = tmp_path / "v.mkv"
    levels = np.linspace(0, 65535, 64).astype(np.uint16)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv444p10le"
        context = stream.codec_context
        context.color_trc, context.color_primaries = transfer, ColorPrimaries.BT2020
        context.colorspace = Colorspace.BT2020
        grey = np.repeat(np.tile(levels, (48, 1))[..., None], 3, axis=2)
        frame = av.VideoFrame.from_ndarray(grey, format="rgb48le")
        frame = frame.reformat(format="yuv444p10le", dst_colorspace=Colorspace.BT2020)
        frame.color_trc, frame.color_primaries = ColorTrc(transfer), ColorPrimaries.BT2020
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    found, capture = read(path)
    assert any(f"({name}) are tone-mapped" in note for note in capture.notes)
    row = found[0][0].astype(int)
    assert np.ptp(row, axis=1).max() <= 2, "what was grey is coloured"
    assert (np.diff(row[:, 1]) >= 0).all() and row[0, 1] == 0 and row[-1, 1] > 220
    # A white page of 203 cd/m^2: 58 % of PQ, 75 % of HLG (BT.2408); skin is about half of it.
    page = row[int(64 * (0.58 if name == "PQ" else 0.75)), 1]
    assert 180 < page < 245


def test_tone_mapping_takes_colours_to_the_primaries_of_bt709() -> None:
    red = np.zeros((1, 1, 3), np.uint16)
    red[..., 0] = 30000
    blue, green, found = ToneMapper("PQ").apply(red)[0, 0]
    assert found > 60 and blue == green == 0


def test_pictures_of_another_size_are_fitted_into_the_first_and_said(tmp_path: Path) -> None:
    first, second = tmp_path / "a.264", tmp_path / "b.264"
    upright = [ramp(n, 48, 96) for n in range(3)]
    write(first, PICTURES[:3], "libx264", "yuv420p", options={"crf": "5"})
    write(second, upright, "libx264", "yuv420p", options={"crf": "5"})
    (tmp_path / "v.264").write_bytes(first.read_bytes() + second.read_bytes())
    found, capture = read(tmp_path / "v.264")
    assert [picture.shape for picture in found] == [(48, 64, 3)] * 6
    # Turned, a phone shows the same upright: between black borders.
    assert (found[-1][:, :15] < 30).all() and (found[-1][:, -15:] < 30).all()
    assert_like([found[-1][:, 20:44]], [upright[-1][::2, ::2]], 12)
    assert any("all are fitted into 64x48" in note for note in capture.notes)


DISPLAY_MATRICES: dict[str, tuple[int, bool, Callable[[Picture], Picture]]] = {
    "as it is": (0, False, lambda p: p),
    "turned by 90": (90, False, lambda p: np.rot90(p, 1)),
    "turned by 180": (180, False, lambda p: np.rot90(p, 2)),
    "turned by 270": (270, False, lambda p: np.rot90(p, 3)),
    "mirrored": (0, True, lambda p: p[:, ::-1]),
    "turned and mirrored": (90, True, lambda p: np.rot90(p, 1)[:, ::-1]),
}


@pytest.mark.parametrize("kind", DISPLAY_MATRICES)
def test_the_display_matrix_is_applied(tmp_path: Path, kind: str) -> None:
    degrees, is_mirrored, applied = DISPLAY_MATRICES[kind]
    path = tmp_path / "v.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv444p"
        stream.set_display_rotation(degrees, hflip=is_mirrored)
        for picture in PICTURES:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))
    assert_like(read(path)[0], [applied(picture) for picture in PICTURES], 4)


def write_interlaced(path: Path, count: int) -> None:
    """A bright bar that moves by 4 pixels a field, as MPEG-2 in fields, the upper one first."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg2video", rate=25, options={"qscale": "2"})
        stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p"
        stream.codec_context.flags |= Flags.interlaced_dct | Flags.interlaced_me
        for number in range(count):
            picture = np.full((96, 128, 3), 40, np.uint8)
            for field in (0, 1):
                left = 10 + 4 * (2 * number + field)
                picture[field::2, left : left + 20] = 200
            frame = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(format="yuv420p")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def combing(picture: Picture) -> float:
    """How much rows differ from both their neighbours."""
    rows = picture[..., 1].astype(float)
    return float(np.abs(rows[1:-1] - (rows[:-2] + rows[2:]) / 2).mean())


def test_interlaced_pictures_are_deinterlaced_and_said(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "v.mpg"
    write_interlaced(path, 8)
    with av.open(str(path)) as container:
        stored = [
            np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
            for frame in container.decode(video=0)
        ]
    found, capture = read(path)
    assert len(found) == len(stored) == 8
    for before, after in zip(stored[1:-1], found[1:-1], strict=True):
        assert combing(before) > 6 and combing(after) < combing(before) / 4
        middle = after[20:-20]
        assert (middle > 150).any()
    assert any("deinterlaced" in note for note in capture.notes)
    assert capfd.readouterr() == ("", "")


def test_what_is_progressive_is_not_touched(tmp_path: Path) -> None:
    write(tmp_path / "v.mpg", PICTURES, "mpeg2video", "yuv420p", options={"qscale": "2"})
    found, capture = read(tmp_path / "v.mpg")
    assert len(found) == 8 and capture.notes == []


def test_the_cover_of_a_video_is_not_its_picture(tmp_path: Path) -> None:
    path = tmp_path / "v.mp4"
    with av.open(str(path), "w") as container:
        cover = container.add_stream("mjpeg", rate=25)
        cover.width, cover.height, cover.pix_fmt = 200, 200, "yuvj420p"
        cover.disposition = Disposition.attached_pic
        stream = container.add_stream("libx264", rate=25, options={"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv444p"
        container.mux(cover.encode(av.VideoFrame.from_ndarray(ramp(0, 200, 200), format="rgb24")))
        container.mux(cover.encode(None))
        for picture in PICTURES:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))
    assert_like(read(path)[0], PICTURES, 4)


def test_of_several_video_streams_the_default_is_read(tmp_path: Path) -> None:
    path = tmp_path / "v.mkv"
    large = [ramp(n, 128, 96) for n in range(4)]
    with av.open(str(path), "w") as container:
        streams = []
        for pictures in (PICTURES[:4], large):
            stream = container.add_stream("ffv1", rate=25)
            stream.disposition = Disposition.default if pictures is large else Disposition(0)
            stream.height, stream.width = pictures[0].shape[:2]
            stream.pix_fmt = "bgr0"
            streams.append((stream, pictures))
        for number in range(4):
            for stream, pictures in streams:
                frame = av.VideoFrame.from_ndarray(pictures[number], format="rgb24")
                container.mux(stream.encode(frame))
        for stream, _ in streams:
            container.mux(stream.encode(None))
    assert_like(read(path)[0], large, 1)


def test_a_file_with_sound_only_is_called_that(tmp_path: Path) -> None:
    path = tmp_path / "song.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=44100)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 44100), np.float32), "fltp", "mono")
        frame.sample_rate = 44100
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(UserError, match=r"song\.mp4 has sound only"):
        read(path)


def test_a_cut_off_file_says_how_much_is_missing(tmp_path: Path) -> None:
    pictures = [ramp(n) for n in range(100)]
    write(tmp_path / "whole.mkv", pictures, "ffv1", "bgr0")
    data = (tmp_path / "whole.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(data[: len(data) // 2])
    found, capture = read(tmp_path / "cut.mkv")
    assert 30 < len(found) < 60
    [note] = capture.notes
    missing = int(note.split(": ")[1].split()[0])
    assert len(found) + missing == pytest.approx(100, abs=1)
    assert read(tmp_path / "whole.mkv")[1].notes == []


def test_damaged_frames_are_passed_over_and_counted(tmp_path: Path) -> None:
    pictures = [ramp(n) for n in range(40)]
    write(tmp_path / "whole.avi", pictures, "png", "rgb24")
    data = bytearray((tmp_path / "whole.avi").read_bytes())
    with av.open(str(tmp_path / "whole.avi")) as container:
        begins = [packet.pos for packet in container.demux(video=0) if packet.size]
    for number in (5, 6, 20):
        start = data.index(b"\x89PNG", begins[number] or 0)
        data[start + 16 : start + 24] = bytes(8)  # Its width and height.
    (tmp_path / "v.avi").write_bytes(data)
    found, capture = read(tmp_path / "v.avi")
    kept = [picture for n, picture in enumerate(pictures) if n not in (5, 6, 20)]
    assert_like(found, kept, 1)
    assert any("3 frames could not be read" in note for note in capture.notes)


def test_a_recording_that_begins_between_key_frames_begins_with_the_first(tmp_path: Path) -> None:
    pictures = [ramp(n) for n in range(50)]
    options = {"g": "20", "bf": "0", "crf": "5", "sc_threshold": "0"}
    write(tmp_path / "whole.ts", pictures, "libx264", "yuv444p", options=options)
    path = tmp_path / "v.ts"
    with av.open(str(tmp_path / "whole.ts")) as whole, av.open(str(path), "w") as container:
        stream = container.add_stream_from_template(whole.streams.video[0])
        for number, packet in enumerate(whole.demux(video=0)):
            if packet.size and number >= 8:
                packet.stream = stream
                container.mux(packet)
    found, capture = read(path)
    assert_like(found, pictures[20:], 4)
    assert any("12 frames could not be read" in note for note in capture.notes)
    assert not capture.times.ticks


@pytest.mark.parametrize("suffix", ["mkv", "mp4", "webm"])
def test_the_times_of_a_rate_that_changes_are_kept(tmp_path: Path, suffix: str) -> None:
    times = [round(n * 1000 / 30) for n in range(20)]
    times += [667 + 100 * n for n in range(20)]
    codec = "libvpx-vp9" if suffix == "webm" else "libx264"
    pictures = [ramp(n) for n in range(40)]
    write(tmp_path / f"v.{suffix}", pictures, codec, "yuv420p", times, 30)
    found, capture = read(tmp_path / f"v.{suffix}")
    assert len(found) == 40
    shown = [capture.times.time_s(n) for n in range(40)]
    assert np.abs(np.array(shown) - np.array(times) / 1000).max() < 0.005


@pytest.mark.parametrize("first_ms", [-2000, 5, 3_600_000])
def test_time_stamps_may_begin_anywhere(tmp_path: Path, first_ms: int) -> None:
    times = [first_ms + 40 * n for n in range(10)]
    write(tmp_path / "v.mkv", [ramp(n) for n in range(10)], times=times)
    found, capture = read(tmp_path / "v.mkv")
    assert len(found) == 10 and capture.fps == 25 and not capture.times.ticks


def test_time_stamps_that_jump_by_hours_are_closed_and_said(tmp_path: Path) -> None:
    times = [40 * n + (28_800_000 if n >= 5 else 0) for n in range(10)]
    write(tmp_path / "v.mkv", [ramp(n) for n in range(10)], times=times)
    found, capture = read(tmp_path / "v.mkv")
    assert len(found) == 10
    assert capture.times.time_s(9) == pytest.approx(0.36, abs=0.005)
    assert any("time stamps jump" in note for note in capture.notes)


def test_time_stamps_that_begin_again_are_closed() -> None:
    seconds = [Fraction(n, 25) for n in [*range(100, 150), *range(40)]]
    stamps = ordered_time_stamps(seconds)
    assert stamps.jumps == 1 and len(stamps.times_s) == 90
    assert np.allclose(np.diff(np.array(stamps.times_s, float)), 0.04)


def test_frames_that_share_a_time_are_spread() -> None:
    stamps = ordered_time_stamps([Fraction(n, 10) for n in (0, 1, 1, 2, 3, 3)])
    assert [float(10 * t) for t in stamps.times_s] == [0, 1, 1.5, 2, 3, 4]


@pytest.fixture
def transport_stream(tmp_path: Path) -> Path:
    write(tmp_path / "v.ts", PICTURES, "libx264", "yuv444p", options={"crf": "5"})
    return tmp_path / "v.ts"


def piped(source: Path, pipe: Path) -> Thread:
    """A thread that writes a file into a new named pipe."""
    os.mkfifo(pipe)
    thread = Thread(target=lambda: pipe.write_bytes(source.read_bytes()), daemon=True)
    thread.start()
    return thread


def test_a_named_pipe_is_read_as_it_comes(tmp_path: Path, transport_stream: Path) -> None:
    thread = piped(transport_stream, tmp_path / "pipe.ts")
    found, _ = read(tmp_path / "pipe.ts")
    thread.join()
    assert_like(found, PICTURES, 4)


def standard_input_frames(source: Path, name: str) -> Iterator[float]:
    """The mean of each frame that another process reads from its standard input."""
    code = (
        "import sys; from encoder.capture.video_source import open_source\n"
        "with open_source(sys.argv[1]) as capture:\n"
        "    for _, frame in capture: print(frame.mean())"
    )
    with source.open("rb") as file:
        done = subprocess.run(
            [sys.executable, "-c", code, name], stdin=file, capture_output=True, check=True
        )
    assert done.stderr == b""
    return map(float, done.stdout.split())


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_standard_input_is_read(transport_stream: Path, name: str) -> None:
    means = list(standard_input_frames(transport_stream, name))
    np.testing.assert_allclose(means, [picture.mean() for picture in PICTURES], atol=2)


def test_a_pipe_is_kept_in_a_file_for_who_reads_twice(
    tmp_path: Path, transport_stream: Path
) -> None:
    thread = piped(transport_stream, tmp_path / "pipe.ts")
    with spooled(str(tmp_path / "pipe.ts")) as copy:
        for _ in range(2):
            assert_like(read(copy)[0], PICTURES, 4)
        assert Path(copy).name == "pipe.ts"
    thread.join()
    assert not Path(copy).exists()


def test_an_empty_pipe_is_said(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    thread = piped(tmp_path / "empty", tmp_path / "pipe.ts")
    with (
        pytest.raises(UserError, match=r"nothing came from pipe\.ts"),
        spooled(str(tmp_path / "pipe.ts")),
    ):
        pass
    thread.join()


def write_stretched(path: Path, aspect: Fraction, degrees: int = 0) -> None:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"crf": "5"})
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv444p"
        stream.codec_context.sample_aspect_ratio = aspect
        stream.set_display_rotation(degrees)
        for picture in PICTURES:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode(None))


@pytest.mark.parametrize(
    ("aspect", "degrees", "size"),
    [
        (Fraction(2), 0, (128, 48)),
        (Fraction(2), 90, (48, 128)),
        (Fraction(1, 2), 0, (64, 96)),
        (Fraction(12, 11), 0, (64, 48)),
    ],
)
def test_pixels_that_are_not_square_are_stretched_for_who_asks(
    tmp_path: Path, aspect: Fraction, degrees: int, size: tuple[int, int]
) -> None:
    write_stretched(tmp_path / "v.mp4", aspect, degrees)
    found, capture = read(tmp_path / "v.mp4")
    assert capture.sample_aspect == (1 / aspect if degrees else aspect)
    assert found[0].shape[:2] == (SIZE if degrees else SIZE[::-1])
    with open_source(str(tmp_path / "v.mp4"), square_pixels=True) as square:
        pictures = [frame for _, frame in square]
        assert (square.width, square.height) == size
        assert square.format.source_size == (found[0].shape[1], found[0].shape[0])
    assert {picture.shape for picture in pictures} == {(size[1], size[0], 3)}
    assert len(square.notes) == (size not in (SIZE, SIZE[::-1]))
