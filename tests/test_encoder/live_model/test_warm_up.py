"""After a warm-up nothing is left to be compiled or loaded when frames come."""

import subprocess
import sys
from pathlib import Path

import pytest
from shots import draw, talking

# In a process of its own: the tests before this one have compiled most of what there is.
COUNT = """
import gc, sys
from pathlib import Path
from numba.core.registry import CPUDispatcher
from encoder.options import EncodeOptions
from encoder.pipeline import encode

def versions():
    loops = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]
    return {f"{each.py_func.__module__}.{each.__name__}": len(each.signatures) for each in loops}

source, output = map(Path, sys.argv[1:])
"""
LIVE = """
from encoder.live_model import learning_process
warmed_up, warm_up = [], learning_process.warm_up
def warm_up_and_count(*arguments):
    warm_up(*arguments)
    warmed_up.append(versions())
learning_process.warm_up = warm_up_and_count
options = EncodeOptions(str(source), output, profile="default", live=True, pace=True)
encode(options, lambda done, total: None, lambda: False)
(before,) = warmed_up
"""
COMPILED = """
from encoder.compiled_loops import compile_loops
compile_loops()
before = versions()
for profile in ("thesis", "default"):
    options = EncodeOptions(str(source), output, profile=profile, max_frames=14)
    encode(options, lambda *_: None, lambda: False)
"""
LATE = """
late = {name for name, count in versions().items() if count != before.get(name, 0)}
assert any(before.values())
print(*sorted(late))
"""


@pytest.mark.parametrize("steps", [LIVE, COMPILED], ids=["real time", "compiled"])
def test_a_call_compiles_nothing_once_it_has_begun(
    steps: str, networks: Path, tmp_path: Path
) -> None:
    # A live call needs the time to learn an update.
    draw(tmp_path / "clip.mkv", talking(2 if steps is LIVE else 1.24))
    arguments = [str(tmp_path / "clip.mkv"), str(tmp_path / "call.rzo")]
    program = [sys.executable, "-c", COUNT + steps + LATE]
    done = subprocess.run([*program, *arguments], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()) == (0, []), done.stderr
