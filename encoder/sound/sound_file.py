"""The first sound track of a video file, on the clock of its pictures."""

from collections.abc import Callable, Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
from av.audio.frame import AudioFrame
from av.audio.resampler import AudioResampler
from av.audio.stream import AudioStream
from av.container import InputContainer
from av.video.frame import VideoFrame

from encoder.capture.containers import open_container, readable_frames, shown_video
from shared_model.arrays import Samples
from shared_model.errors import UserError

Warn = Callable[[str], None]

# Sound that is so much late or early by its time stamps is put where they say.
MAX_TIMING_ERROR_S = 0.04
# Time stamps that jump ahead or back by more say nothing, as those of pictures
# (`encoder.capture.time_stamps`); the sound may begin so long before or after the pictures.
MAX_GAP_S, MAX_RETURN_S, MAX_START_S = 10, 1, 3600
# The most that is held at once, seconds.
PIECE_S = 1
# A track with more damaged packets than this is left.
MAX_DAMAGED = 1000
# Two channels are each other's inverse if their difference has so many times the energy of their
# sum, on average over about so many seconds.
ANTIPHASE_RATIO, ANTIPHASE_S = 30.0, 0.5


def has_sound(source: str | Path) -> bool:
    """Whether a file, or a recording with a URL, has a sound track."""
    # A pipe or device can be read only once, and so can a stream without an end.
    is_remote = "://" in str(source)
    if not is_remote and not Path(source).is_file():
        return False
    try:
        with _open(source) as container:
            return bool(container.streams.audio) and not (is_remote and not container.duration)
    except UserError:
        return False


def read_sound(
    source: str | Path, rate_hz: int, warn: Warn = lambda line: None
) -> Iterator[Samples]:
    """The first sound track of a file or URL, mono, in pieces (n,) int16; it begins with picture 0.

    Ends where the track ends; what cannot be read is left out.
    warn: called with a line for each thing that is wrong with it.
    """
    with _open(source) as container:
        stream = container.streams.audio[0]
        mono, placing = _Mono(rate_hz), _Placing(_video_start_s(source), rate_hz, warn)
        for frame in _frames(container, stream, warn):
            yield from placing.placed(mono.samples(frame), frame)
        yield from placing.placed(mono.rest(), None)


class _Mono:
    """Turns frames of any format into mono at one rate, (n,) int16."""

    def __init__(self, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        self._resampler: AudioResampler | None = None
        self._format: tuple[str, str, int] | None = None
        self._sum = self._difference = 0.0  # energies

    def samples(self, frame: AudioFrame) -> Samples:
        """Those of a frame; some come with a later one."""
        frame = self._without_antiphase(frame)
        own = frame.format.name, frame.layout.name, frame.sample_rate
        before = np.zeros(0, np.int16)
        if own != self._format:
            # The format may change in the middle of a file.
            before, self._format = self.rest(), own
            self._resampler = AudioResampler(format="s16", layout="mono", rate=self._rate_hz)
        assert self._resampler is not None
        return np.concatenate([before, *map(_flat, self._resampler.resample(frame))])

    def rest(self) -> Samples:
        """Those that are left."""
        if self._resampler is None:
            return np.zeros(0, np.int16)
        return np.concatenate([np.zeros(0, np.int16), *map(_flat, self._resampler.resample(None))])

    def _without_antiphase(self, frame: AudioFrame) -> AudioFrame:
        """The frame, or its first channel where the sum of its two channels would be silence."""
        if frame.layout.nb_channels != 2:
            return frame
        data = np.asarray(frame.to_ndarray())
        pair = data if len(data) == 2 else data.reshape(-1, 2).T
        zero = 128.0 if data.dtype == np.uint8 else 0.0
        left, right = pair.astype(np.float64) - zero
        share = min(1.0, frame.samples / (ANTIPHASE_S * frame.sample_rate))
        self._sum += share * (float(((left + right) ** 2).mean()) - self._sum)
        self._difference += share * (float(((left - right) ** 2).mean()) - self._difference)
        if self._difference <= ANTIPHASE_RATIO * self._sum:
            return frame
        kind = frame.format.packed.name
        first = AudioFrame.from_ndarray(np.ascontiguousarray(pair[:1]), kind, "mono")
        first.sample_rate, first.pts, first.time_base = (
            frame.sample_rate,
            frame.pts,
            frame.time_base,
        )
        return first


class _Placing:
    """Puts samples where their time stamps say.  start_s: time of picture 0."""

    def __init__(self, start_s: Fraction, rate_hz: int, warn: Warn) -> None:
        self._start_s, self._rate_hz, self._warn = start_s, rate_hz, warn
        self._written, self._has_jumped = 0, False

    def placed(self, samples: Samples, frame: AudioFrame | None) -> Iterator[Samples]:
        """Samples (n,) of a frame, with silence before them where they are late."""
        late = 0 if frame is None else self._late(frame)
        if abs(late) <= MAX_TIMING_ERROR_S * self._rate_hz:
            late = 0
        while late > 0:
            silence = min(late, PIECE_S * self._rate_hz)
            late -= silence
            yield self._counted(np.zeros(silence, np.int16))
        yield self._counted(samples[-late:] if late < 0 else samples)

    def _counted(self, samples: Samples) -> Samples:
        self._written += len(samples)
        return samples

    def _late(self, frame: AudioFrame) -> int:
        """How many samples are missing before a frame, by its time stamp; less than 0: too many."""
        if frame.pts is None or frame.time_base is None:
            return 0
        due_s = frame.pts * frame.time_base - self._start_s
        late_s = due_s - Fraction(self._written, self._rate_hz)
        has_begun = self._written > 0
        earliest, latest = (-MAX_RETURN_S, MAX_GAP_S) if has_begun else (-MAX_START_S, MAX_START_S)
        if earliest <= late_s <= latest:
            return round(late_s * self._rate_hz)
        # From now on time stamps count from here.
        self._start_s += late_s
        if not self._has_jumped:
            self._has_jumped = True
            self._warn("time stamps of the sound jump: it goes on as if they did not")
        return 0


def _flat(frame: AudioFrame) -> Samples:
    return np.asarray(frame.to_ndarray(), np.int16).reshape(-1)


def _open(source: str | Path) -> InputContainer:
    return open_container(str(source), str(source), "://" in str(source))


def _video_start_s(source: str | Path) -> Fraction:
    """Time of the first picture that can be shown; 0 without one."""
    with _open(source) as container:
        stream = shown_video(container)
        frames = iter(()) if stream is None else readable_frames(container, stream, VideoFrame)
        first = next(frames, None)
        if first is None or first.pts is None or first.time_base is None:
            return Fraction(0)
        return first.pts * first.time_base


def _frames(container: InputContainer, stream: AudioStream, warn: Warn) -> Iterator[AudioFrame]:
    """The frames of a sound track; damaged ones are passed over."""
    damaged = list[None]()
    note = partial(damaged.append, None)
    is_cut = yield from readable_frames(container, stream, AudioFrame, note, MAX_DAMAGED)
    if pieces := len(damaged) + is_cut:
        warn(f"the sound is damaged: {pieces} pieces of it could not be read")
