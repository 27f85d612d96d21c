"""What takes the pictures of a call, wherever they go."""

from fractions import Fraction
from pathlib import Path
from typing import Self

from shared_model.arrays import Picture, Samples


class FrameSink:
    """Takes the pictures of one call in order."""

    def write(self, picture: Picture, time_s: Fraction | None = None) -> None:
        """Add one picture, (height, width, 3) uint8 BGR.

        time_s: when it is shown, seconds from the start, where the frame rate varies.
        """
        raise NotImplementedError

    def write_sound(self, samples: Samples) -> None:
        """Add samples, (n,) int16, to the sound track, if there is one."""

    def mark_incomplete(self) -> Path | None:
        """State that pictures are missing at the end, so that an older file keeps its name.

        Returns the path of the pictures then; None if it is the sink's own.
        """
        return None

    def close(self) -> None:
        """Finish the files; pictures written before are kept.  Closing twice changes nothing."""

    def __enter__(self) -> Self:
        """Return the sink, which is closed on leaving the block."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close; after an exception the pictures are incomplete."""
        if any(exception):
            self.mark_incomplete()
        self.close()
