"""Video sources: every kind, exact rates, one-line errors."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import av
import cv2
import numpy as np
import pytest
from av.video.reformatter import ColorPrimaries, Colorspace

from encoder.capture.frame_times import exact_fps
from encoder.capture.video_source import open_source, why_not_opened
from shared_model.arrays import Picture
from shared_model.errors import UserError

CLIPS = Path(__file__).resolve().parents[4] / "shared" / "clips"


def write_video(path: Path, sizes: list[tuple[int, int]], fps: float = 30.0) -> None:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), fps, sizes[0])
    for index, (width, height) in enumerate(sizes):
        writer.write(np.full((height, width, 3), index * 20, np.uint8))
    writer.release()


def write_images(folder: Path, numbers: list[int], size: tuple[int, int] = (40, 30)) -> None:
    for number in numbers:
        image = np.full((size[1], size[0], 3), number, np.uint8)
        cv2.imwrite(str(folder / f"frame_{number:04d}.png"), image)


def write_tagged(path: Path, matrix: int, primaries: int = ColorPrimaries.UNSPECIFIED) -> None:
    """A grey picture as a video whose Y'CbCr is said to be made by this matrix."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.colorspace = matrix
        stream.codec_context.color_primaries = primaries
        grey = np.full((72, 64), 128, np.uint8)
        container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="yuv420p")))
        container.mux(stream.encode(None))


@pytest.mark.parametrize(
    ("reported", "exact"),
    [
        (25.0, Fraction(25)),
        (29.97002997, Fraction(30000, 1001)),
        (29.97, Fraction(30000, 1001)),
        (23.976, Fraction(24000, 1001)),
        (59.94, Fraction(60000, 1001)),
        (30.0, Fraction(30)),
        (12.5, Fraction(25, 2)),
        (0.0, Fraction(25)),
        (-1.0, Fraction(25)),
        (90000.0, Fraction(25)),
        (float("nan"), Fraction(25)),
        (float("inf"), Fraction(25)),
    ],
)
def test_rate_is_exact_and_absurd_rates_become_25(reported: float, exact: Fraction) -> None:
    assert exact_fps(reported) == exact


@pytest.mark.parametrize(("fps", "assumed"), [(30.0, False), (0.5, True), (1000.0, True)])
def test_an_unusable_rate_is_replaced_and_marked_as_assumed(
    fps: float, assumed: bool, tmp_path: Path
) -> None:
    write_video(tmp_path / "v.avi", [(64, 48)] * 3, fps)
    with open_source(str(tmp_path / "v.avi")) as capture:
        assert capture.is_fps_assumed == assumed
        assert capture.fps == (25 if assumed else 30)


def test_video_file_gives_every_frame_in_order(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mkv", [(64, 48)] * 5)
    with open_source(str(tmp_path / "v.mkv")) as capture:
        frames = list(capture)
    assert (capture.width, capture.height, capture.fps) == (64, 48, Fraction(30))
    assert not capture.is_live
    assert [index for index, _ in frames] == list(range(5))
    assert [round(frame.mean() / 20) for _, frame in frames] == list(range(5))


@pytest.mark.parametrize(
    ("tag", "primaries", "matrix"),
    [
        (Colorspace.ITU709, ColorPrimaries.BT709, "bt709"),
        (Colorspace.ITU709, ColorPrimaries.UNSPECIFIED, "bt709"),
        (Colorspace.ITU601, ColorPrimaries.SMPTE170M, "bt601"),
        (Colorspace.BT2020, ColorPrimaries.BT2020, "bt601"),
    ],
)
def test_the_colour_matrix_of_a_file_is_that_of_its_tag(
    tmp_path: Path, tag: int, primaries: int, matrix: str
) -> None:
    write_tagged(tmp_path / "v.mkv", tag, primaries)
    with open_source(str(tmp_path / "v.mkv")) as capture:
        assert capture.colour_matrix == matrix


def test_a_file_without_a_tag_is_bt601(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mkv", [(64, 48)])
    write_images(tmp_path, [1])
    for name in ("v.mkv", "frame_%04d.png"):
        with open_source(str(tmp_path / name)) as capture:
            assert capture.colour_matrix == "bt601"


def test_an_unreadable_file_is_refused_without_a_message_of_a_library(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    write_tagged(tmp_path / "whole.mkv", Colorspace.ITU709)
    (tmp_path / "cut.mkv").write_bytes((tmp_path / "whole.mkv").read_bytes()[:300])
    (tmp_path / "text.mp4").write_text("not a video\n" * 100)
    for name in ("cut.mkv", "text.mp4"):
        assert name in one_line_error(tmp_path / name)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("first", [0, 1, 117])
def test_image_sequence_starts_at_its_lowest_number(tmp_path: Path, first: int) -> None:
    write_images(tmp_path, [first, first + 1, first + 2])
    with open_source(str(tmp_path / "frame_%04d.png")) as capture:
        values = [int(frame[0, 0, 0]) for _, frame in capture]
    assert values == [first, first + 1, first + 2]
    assert capture.frame_count == 3


def one_line_error(source: Path | str) -> str:
    with pytest.raises(UserError) as caught, open_source(str(source)) as capture:
        list(capture)
    message = str(caught.value)
    assert "\n" not in message and caught.value.exit_code == 2
    return message


def test_missing_file_is_named(tmp_path: Path) -> None:
    assert "none.mp4" in one_line_error(tmp_path / "none.mp4")


def test_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "text.mp4").write_text("not a video\n" * 100)
    assert "text.mp4" in one_line_error(tmp_path / "text.mp4")


def test_empty_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "empty.mp4").touch()
    assert "empty.mp4" in one_line_error(tmp_path / "empty.mp4")


def test_video_without_frames_is_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "v.mkv", [(64, 48)] * 3)
    data = (tmp_path / "v.mkv").read_bytes()
    (tmp_path / "cut.mkv").write_bytes(data[: data.index(b"\x1f\x43\xb6\x75")])
    assert "cut.mkv" in one_line_error(tmp_path / "cut.mkv")


def test_folder_is_refused_with_a_hint(tmp_path: Path) -> None:
    assert "%04d" in one_line_error(tmp_path)


def test_sequence_without_files_with_a_gap_or_without_number_is_refused(tmp_path: Path) -> None:
    assert "matches" in one_line_error(tmp_path / "frame_%04d.png")
    assert "matches" in one_line_error(tmp_path / "nowhere" / "frame_%04d.png")
    assert "one number" in one_line_error(tmp_path / "frame_%s.png")
    write_images(tmp_path, [1, 2, 4])
    assert "frame_0003.png" in one_line_error(tmp_path / "frame_%04d.png")


def test_sequence_with_a_broken_image_is_refused(tmp_path: Path) -> None:
    write_images(tmp_path, [1, 2])
    (tmp_path / "frame_0003.png").write_bytes(b"nothing")
    assert "frame_0003.png" in one_line_error(tmp_path / "frame_%04d.png")


def test_frames_that_change_size_are_refused(tmp_path: Path) -> None:
    write_images(tmp_path, [1, 2])
    write_images(tmp_path, [3], size=(42, 30))
    assert "42x30" in one_line_error(tmp_path / "frame_%04d.png")


def test_stream_that_does_not_answer_is_refused() -> None:
    assert "rtsp" in one_line_error("rtsp://127.0.0.1:9/none")


def test_camera_that_is_not_there_is_refused() -> None:
    assert "camera 63" in one_line_error("63")


@pytest.mark.parametrize(
    ("name", "frames", "size", "fps"),
    [
        ("carphone.mp4", 120, (176, 144), Fraction(30000, 1001)),
        ("akiyo.mp4", 300, (352, 288), Fraction(25)),
        ("foreman.264", 299, (352, 288), Fraction(25)),
        ("still.mpg", 75, (360, 288), Fraction(25)),
        ("smile.mp4", 72, (640, 360), Fraction(30)),
        ("webcam/frame_%04d.png", 49, (640, 480), Fraction(25)),
    ],
)
def test_real_clips_have_their_published_frames(
    name: str, frames: int, size: tuple[int, int], fps: Fraction
) -> None:
    if not CLIPS.is_dir():
        pytest.skip(f"{CLIPS} is not there")
    with open_source(str(CLIPS / name)) as capture:
        count = sum(1 for _ in capture)
    assert (count, (capture.width, capture.height), capture.fps) == (frames, size, fps)
    assert capture.frame_count in (frames, None)


class _Camera(BaseHTTPRequestHandler):
    """Pictures without end, as a network camera sends them: each brighter than the one before."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        try:
            for number in range(250):
                ok, data = cv2.imencode(".jpg", np.full((48, 64, 3), number, np.uint8))
                assert ok
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.wfile.write(head.encode() + data.tobytes() + b"\r\n")
        except OSError:
            pass  # Whoever looked has gone.

    def log_message(self, format: str, *args: object) -> None:
        pass


@contextmanager
def camera() -> Iterator[str]:
    with ThreadingHTTPServer(("127.0.0.1", 0), _Camera) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/camera.mjpg"
        finally:
            server.shutdown()
            thread.join()


def test_frames_of_a_live_source_are_dropped_while_busy() -> None:
    with camera() as url, open_source(url) as capture:
        assert capture.is_live
        busy, dropped = iter([True] * 40 + [False]), list[Picture]()
        capture.drop_frames_while(lambda: next(busy), dropped.append)
        frames = iter(capture)
        found = [next(frames) for _ in range(3)]
    assert [index for index, _ in found] == [0, 1, 2]
    np.testing.assert_allclose([frame.mean() for _, frame in found], [40, 41, 42], atol=0.6)
    np.testing.assert_allclose([frame.mean() for frame in dropped], range(1, 41), atol=0.6)


@pytest.mark.parametrize(
    ("rate", "fps"),
    [("", 25), ("@30", 30), ("@12.5", 12.5), ("@30000/1001", Fraction(30000, 1001))],
)
def test_an_image_sequence_has_the_rate_that_is_asked_for(
    tmp_path: Path, rate: str, fps: float | Fraction
) -> None:
    write_images(tmp_path, [1, 2, 3])
    with open_source(f"{tmp_path}/frame_%04d.png{rate}") as capture:
        assert capture.fps == fps and len(list(capture)) == 3


@pytest.mark.parametrize("rate", ["0", "1000"])
def test_a_rate_that_cannot_be_is_refused(tmp_path: Path, rate: str) -> None:
    write_images(tmp_path, [1])
    assert "1 to 240" in one_line_error(f"{tmp_path}/frame_%04d.png@{rate}")


def test_a_camera_that_does_not_open_says_why_and_what_there_is(tmp_path: Path) -> None:
    assert why_not_opened(7, tmp_path) == "there is no camera on this host"
    for number in (0, 2):
        (tmp_path / f"video{number}").touch()
    assert why_not_opened(7, tmp_path) == "there is none of this number; there are 0, 2"
    assert "another program" in why_not_opened(2, tmp_path)
    (tmp_path / "video2").chmod(0)
    if not os.access(tmp_path / "video2", os.R_OK):  # root may read all
        assert "no permission" in why_not_opened(2, tmp_path)
