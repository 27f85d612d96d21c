"""The OpenGL context draws without threads of the software renderer."""

import os
import subprocess
import sys

from conftest import ROOT


def test_software_draws_without_threads_of_its_own() -> None:
    """They write to memory that is freed already: now and then the decoder aborted."""
    code = (
        "from pathlib import Path\n"
        "from decoder.rendering.gl_context import create_context\n"
        "context = create_context()\n"
        "print(*(name.read_text() for name in Path('/proc/self/task').glob('*/comm')))"
    )
    environment = {name: value for name, value in os.environ.items() if name != "LP_NUM_THREADS"}
    line = [sys.executable, "-c", code]
    done = subprocess.run(
        line, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    assert done.stdout and "llvmpipe" not in done.stdout
