"""A call between two processes over a serial line."""

from pathlib import Path

from conftest import Start
from processes import finish
from serial_lines import serial_line
from videos import read_frames


def test_a_call_over_a_serial_line_comes_whole(
    slow_clip: Path, start: Start, tmp_path: Path
) -> None:
    video = tmp_path / "out.mkv"
    with serial_line() as (here, there):
        decoder = start("decode", "--listen", f"serial/{there}", "-o", video)
        encoder = start("encode", slow_clip, "--connect", f"serial/{here}", "--profile", "thesis")
        code, stderr = finish(encoder)
        assert code == 0, stderr
        assert "it stays on this serial line" in stderr
        assert finish(decoder)[0] == 0
    assert len(read_frames(video)) == len(read_frames(slow_clip))
