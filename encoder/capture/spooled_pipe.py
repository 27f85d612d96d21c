"""Copies a pipe into a file, for an encoder that reads its source twice."""

import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from encoder.capture.video_source import STANDARD_INPUT
from shared_model.errors import UserError


@contextmanager
def spooled(source: str) -> Iterator[str]:
    """A file with all that comes through a pipe, read to its end; deleted after the `with` block.

    source: see `is_pipe`.  Raises `UserError` if nothing comes or it cannot be kept.
    """
    is_standard = source in STANDARD_INPUT
    name = "standard input" if is_standard else Path(source).name
    with TemporaryDirectory(prefix="risorius-") as folder:
        path = Path(folder) / name
        try:
            with path.open("wb") as file:
                if is_standard:
                    shutil.copyfileobj(sys.stdin.buffer, file)
                else:
                    with Path(source.removeprefix("file://")).open("rb") as pipe:
                        shutil.copyfileobj(pipe, file)
        except OSError as error:
            raise UserError(f"cannot keep what comes from {name}: {error.strerror}") from error
        if not path.stat().st_size:
            raise UserError(f"nothing came from {name}")
        yield str(path)
