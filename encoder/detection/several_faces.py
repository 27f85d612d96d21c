"""What is said where several faces are in the picture."""

from collections.abc import Callable

Warn = Callable[[str], None]


def warn_of_several_faces(count: int, warn: Warn) -> None:
    """Warn if several faces are in the picture."""
    if count > 1:
        warn(f"{count} faces in the picture: taking the largest")
