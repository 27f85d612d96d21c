"""The `ffmpeg` program, for what PyAV's libraries lack: VMAF, and the VVC encoder."""

import json
import os
import shutil
import subprocess
import threading
from collections.abc import Iterable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from loopback.judge.observer import MediaPipeJudge, find_observer
from shared_model.arrays import Picture
from shared_model.errors import UserError

# A writer whose pipe has been opened for it ends within this time.
RELEASE_S = 0.1


def find_ffmpeg(kind: str, feature: str) -> str | None:
    """The path of an `ffmpeg` that has a feature: the judge's, or that of the host; None: neither.

    kind: "filters" or "encoders".
    """
    observer = find_observer()
    return _find(observer.python if isinstance(observer, MediaPipeJudge) else None, kind, feature)


@lru_cache
def _find(python: Path | None, kind: str, feature: str) -> str | None:
    programs = list[str | None]()
    if python is not None:
        ask = "import imageio_ffmpeg; print(imageio_ffmpeg.get_ffmpeg_exe())"
        said = subprocess.run([str(python), "-c", ask], capture_output=True, text=True)
        programs.append(said.stdout.strip() or None)
    programs.append(shutil.which("ffmpeg"))
    for program in filter(None, programs):
        said = subprocess.run([program, "-hide_banner", f"-{kind}"], capture_output=True, text=True)
        if f" {feature} " in said.stdout:
            return program
    return None


def vmaf(
    program: str, originals: Iterable[Picture], copies: Iterable[Picture], size: tuple[int, int]
) -> float:
    """The mean VMAF of pictures (h, w, 3) uint8 BGR of a size (width, height), 0 to 100.

    Raises `UserError` if the program fails.
    """
    with TemporaryDirectory() as folder:
        pipes = [str(Path(folder) / name) for name in ("decoded", "source")]
        log = Path(folder) / "vmaf.json"
        for pipe in pipes:
            os.mkfifo(pipe)
        raw = ["-f", "rawvideo", "-pixel_format", "bgr24", "-video_size", f"{size[0]}x{size[1]}"]
        inputs = [word for pipe in pipes for word in (*raw, "-i", pipe)]
        graph = (
            "[0:v]format=yuv420p[a];[1:v]format=yuv420p[b];"
            f"[a][b]libvmaf=log_fmt=json:log_path={log}"
        )
        command = [program, "-v", "error", "-nostdin", *inputs, "-lavfi", graph, "-f", "null", "-"]
        process = subprocess.Popen(command, stderr=subprocess.PIPE)
        writers = [
            threading.Thread(target=_write, args=(pipe, frames), daemon=True)
            for pipe, frames in zip(pipes, (copies, originals), strict=True)
        ]
        for writer in writers:
            writer.start()
        _, said = process.communicate()
        for writer, pipe in zip(writers, pipes, strict=True):
            _end(writer, pipe)
        if process.returncode:
            words = said.decode(errors="replace").strip()[-200:]
            raise UserError(f"ffmpeg failed at VMAF: {words}")
        found: float = json.loads(log.read_text())["pooled_metrics"]["vmaf"]["mean"]
        return found


def _end(writer: threading.Thread, pipe: str) -> None:
    """Wait for a writer, which may wait for a reader that has failed before it opened the pipe."""
    while writer.is_alive():
        os.close(os.open(pipe, os.O_RDONLY | os.O_NONBLOCK))
        writer.join(RELEASE_S)


def _write(pipe: str, pictures: Iterable[Picture]) -> None:
    with suppress(BrokenPipeError), open(pipe, "wb") as file:
        for picture in pictures:
            file.write(np.ascontiguousarray(picture).tobytes())
