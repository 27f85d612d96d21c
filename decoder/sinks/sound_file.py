"""A file of sound alone: Opus in WebM."""

from pathlib import Path
from typing import Self

import av

from decoder.sinks.sound_stream import SoundStream
from shared_model.arrays import Samples

# Opus' longest packets: at few bits a second their heads would take a third of the file.
PACKET_MS = 120


class SoundFile:
    """A mono WebM file; a context manager, which finishes it.

    rate_hz: samples per second: 8000, 12000, 16000, 24000 or 48000.  bits_per_second: about as
    many.
    """

    def __init__(self, path: Path, rate_hz: int, bits_per_second: int) -> None:
        self._container = av.open(str(path), "w")
        suffix = path.suffix
        self._stream = SoundStream(self._container, suffix, rate_hz, bits_per_second, PACKET_MS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._stream.finish()
        self._container.close()

    def write(self, samples: Samples) -> None:
        """Add samples, (n,) int16."""
        self._stream.write(samples)
