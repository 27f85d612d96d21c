"""Files with secrets in them."""

import os
from contextlib import suppress
from pathlib import Path

from shared_model.errors import cannot_write


def write_private(path: Path, data: bytes, mode: int = 0o600) -> None:
    """Replace a file as a whole; only its owner may read it, from its first byte on.

    mode: another one for what is no secret.  Raises `UserError` if it cannot be written.
    """
    partial = path.with_name(f".{path.name}.partial")
    try:
        partial.unlink(missing_ok=True)
        descriptor = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(data)
        partial.replace(path)
    except OSError as error:
        # What has been written of it may be secret.
        with suppress(OSError):
            partial.unlink(missing_ok=True)
        raise cannot_write(path, error) from error
