"""After `risorius compile` a recorded call is encoded and decoded without compiling anything."""

from pathlib import Path

from late_loops import late_loops
from shots import draw, talking

COMPILED = """
import risorius
from risorius.cli import main
assert main(["compile"]) == 0
before = versions()
for options in {"profile": "thesis"}, {"profile": "default", "bitrate": 3000.0}:
    risorius.encode(source, output, max_frames=14, **options)
    with risorius.open_call(output) as call:
        pictures = [picture for _, picture in call]
    assert len(pictures) == 14
assert risorius.info(output).frame_bps > 1200
"""


def test_calls_compile_nothing(networks: Path, tmp_path: Path) -> None:
    draw(tmp_path / "clip.mkv", talking(1.24))
    assert late_loops(COMPILED, tmp_path / "clip.mkv", tmp_path / "call.rzo") == []
