"""A rehearsed live call: nothing is left to be compiled or loaded when its frames come."""

import subprocess
import sys
from pathlib import Path

from shots import draw, talking

# In a process of its own: the tests before this one have compiled most of what there is.
PROGRAM = """
import gc, sys
from fractions import Fraction
from pathlib import Path
from numba.core.registry import CPUDispatcher
from encoder import pipeline
from encoder.options import EncodeOptions
from encoder.pipeline import encode

def versions():
    loops = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]
    return {f"{each.py_func.__module__}.{each.__name__}": len(each.signatures) for each in loops}

source, output = map(Path, sys.argv[1:])
warmed_up, warm_up = [], pipeline.warm_up
def warm_up_and_count(*arguments):
    warm_up(*arguments)
    warmed_up.append(versions())
pipeline.warm_up = warm_up_and_count
options = EncodeOptions(str(source), output, profile="default", live=True, pace=True)
encode(options, lambda done, total: None, lambda: False)
(before,) = warmed_up
late = {name for name, count in versions().items() if count != before.get(name, 0)}
assert any(before.values())
print(*sorted(late))
"""


def test_a_call_in_real_time_compiles_nothing_once_it_has_begun(
    networks: Path, tmp_path: Path
) -> None:
    draw(tmp_path / "clip.mkv", talking(2))
    arguments = [str(tmp_path / "clip.mkv"), str(tmp_path / "call.rzo")]
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.split()) == (0, []), done.stderr
