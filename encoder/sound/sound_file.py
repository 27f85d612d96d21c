"""The first sound track of a video file, on the clock of its pictures."""

from collections.abc import Iterator
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.audio.stream import AudioStream
from av.container import InputContainer
from numpy.typing import NDArray

Samples = NDArray[np.int16]

# Sound that is so much late or early by its time stamps is put where they say.
MAX_TIMING_ERROR_S = 0.04


def has_sound(path: Path) -> bool:
    """Whether a file has a sound track."""
    # A pipe or device can be read only once.
    if not path.is_file():
        return False
    try:
        with av.open(str(path), metadata_errors="ignore") as container:
            return bool(container.streams.audio)
    except av.FFmpegError:
        return False


def read_sound(path: Path, rate_hz: int) -> Iterator[Samples]:
    """The first sound track of a file, mono, in pieces (n,) int16; it begins with picture 0.

    Ends where the track ends, or where it cannot be read any more.
    """
    with av.open(str(path), metadata_errors="ignore") as container:
        stream = container.streams.audio[0]
        resampler = av.AudioResampler(format="s16", layout="mono", rate=rate_hz)
        start_s, written = _video_start_s(container), 0
        for frame in _frames(container, stream):
            pieces = [piece.to_ndarray().reshape(-1) for piece in resampler.resample(frame)]
            samples = np.concatenate([np.zeros(0, np.int16), *pieces])
            if frame is not None and frame.pts is not None and frame.time_base is not None:
                due = round((frame.pts * frame.time_base - start_s) * rate_hz)
                samples = placed(samples, due - written, MAX_TIMING_ERROR_S * rate_hz)
            written += len(samples)
            yield samples


def placed(samples: Samples, late: int, tolerance: float) -> Samples:
    """Samples (n,) that come `late`: with silence before them, or without those that are too early.

    late, tolerance: number of samples; within the tolerance they stay as they are.
    """
    if abs(late) <= tolerance:
        return samples
    if late < 0:
        return samples[-late:]
    return np.concatenate([np.zeros(late, np.int16), samples])


def _video_start_s(container: InputContainer) -> Fraction:
    """Time of the first picture."""
    for stream in container.streams.video:
        if stream.start_time is not None and stream.time_base is not None:
            return stream.start_time * stream.time_base
    return Fraction(0)


def _frames(container: InputContainer, stream: AudioStream) -> Iterator[av.AudioFrame | None]:
    """The frames of a sound track, then None."""
    # Of a damaged file the rest is left out; its pictures end in the same way.
    with suppress(av.FFmpegError):
        yield from container.decode(stream)
    yield None
