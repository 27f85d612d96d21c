"""`risorius.encode`: options are checked, then the encoder runs."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import BinaryIO

from encoder.option_rules import check_values, checked_options
from encoder.options import EncodeOptions
from encoder.pipeline import encode
from encoder.report import EncodeReport
from risorius.call_drawing import draw

Progress = Callable[[int, int | None], None]


def encode_checked(
    source: str | Path,
    output: str | Path | BinaryIO,
    settings: Mapping[str, object],
    progress: Progress | None,
) -> EncodeReport:
    """See `risorius.encode`.  settings: fields of `EncodeOptions`; profile None: to be chosen."""
    check_values(settings)
    checked = checked_options(settings, lambda name, value: f"{name}={value!r}")
    target = Path(output) if isinstance(output, str) else output
    options = EncodeOptions(str(source), target, draw=draw, **checked)
    return encode(options, progress or _ignore, lambda: False)


def _ignore(done: int, total: int | None) -> None:
    """Do nothing with the progress."""
