"""`risorius.encode`: options are checked, then the encoder runs."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

from encoder.option_rules import check_value, chosen_profile
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from encoder.report import EncodeReport
from risorius.call_drawing import draw

Progress = Callable[[int, int | None], None]


def encode_checked(
    source: str | Path,
    output: str | Path | BinaryIO,
    settings: Mapping[str, Any],
    progress: Progress | None,
) -> EncodeReport:
    """See `risorius.encode`.  settings: fields of `EncodeOptions`; profile None: to be chosen."""
    for name, value in settings.items():
        if value is not None:
            try:
                check_value(name, value)
            except ValueError as error:
                raise ValueError(f"{name}: {error}") from error
    profile = chosen_profile(settings, lambda name, value: f"{name}={value!r}")
    target = Path(output) if isinstance(output, str) else output
    options = EncodeOptions(str(source), target, draw=draw, **{**settings, "profile": profile})
    return encode(options, progress or _ignore, lambda: False)


def _ignore(done: int, total: int | None) -> None:
    """Do nothing with the progress."""
