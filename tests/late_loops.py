"""Which loops a program compiles, or loads, after it has said that it is ready."""

import subprocess
import sys
from pathlib import Path

# In a process of its own: the tests before have compiled most of what there is.
COUNT = """
import gc, sys
from pathlib import Path
from numba.core.registry import CPUDispatcher

def versions():
    loops = [each for each in gc.get_objects() if isinstance(each, CPUDispatcher)]
    return {f"{each.py_func.__module__}.{each.__name__}": len(each.signatures) for each in loops}

source, output = map(Path, sys.argv[1:])
"""
LATE = """
late = {name for name, count in versions().items() if count != before.get(name, 0)}
assert any(before.values())
print(*sorted(late))
"""


def late_loops(steps: str, source: Path, output: Path) -> list[str]:
    """Loops of which `steps`, Python code, calls a version after it has set `before`.

    steps: has `versions()`, all versions so far, and the paths `source` and `output`.
    """
    program = [sys.executable, "-c", COUNT + steps + LATE, str(source), str(output)]
    done = subprocess.run(program, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()
