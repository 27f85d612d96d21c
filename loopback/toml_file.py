"""TOML files that a user writes: suites and animation scripts."""

import tomllib
from pathlib import Path
from typing import Any

from shared_model.errors import UserError, cannot_read


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """The content of a TOML file.

    what: it is to be, for the message, as "a suite".  Raises `UserError`.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise cannot_read(path, error) from error
    except UnicodeDecodeError as error:
        raise UserError(f"{path} is not {what}: it is no text file") from error
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path} is not {what} in TOML: {error}") from error
