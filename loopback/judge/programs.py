"""Runs a judge's program: bytes to its standard input, its findings from its standard output."""

import subprocess
import threading
from collections.abc import Iterable, Mapping, Sequence

from shared_model.errors import UserError


def run_program(
    command: Sequence[str],
    pieces: Iterable[bytes],
    failure: str,
    environment: Mapping[str, str] | None = None,
) -> bytes:
    """What a program writes on standard output when it has read these pieces.

    environment: None: that of this process.
    Raises `UserError`, `failure` and the last line that it says on standard error, if it fails.
    """
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=pipe, env=environment
    ) as process:
        assert process.stdin and process.stdout and process.stderr
        said, complaints = list[bytes](), process.stderr
        reader = threading.Thread(target=lambda: said.append(complaints.read()), daemon=True)
        reader.start()
        try:
            with process.stdin as stream:
                for piece in pieces:
                    stream.write(piece)
        except BrokenPipeError:
            pass  # It has ended, and says why.
        found = process.stdout.read()
        reader.join()
    if process.returncode:
        words = said[0].decode(errors="replace").strip().splitlines()
        raise UserError(f"{failure}: {words[-1] if words else f'exit {process.returncode}'}")
    return found
