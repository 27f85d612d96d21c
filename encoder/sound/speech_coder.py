"""From a stream of samples to speech frames: gate, then codec; what is silent is not sent."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from encoder.sound.speech_encoder import SpeechEncoder
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND
from shared_model.arrays import Samples

FULL_SCALE = 32768.0
# How much of the sound WebRTC's detector takes for speech: 0 most to 3 least.
VAD_MODE = 2
VAD_FRAMES_PER_SECOND = 100
# The level of speech rises and falls so fast while there is speech: a share of the difference in
# each frame, decibels in each frame.
LEVEL_RISE, LEVEL_FALL_DB = 0.3, 0.04
INITIAL_LEVEL_DB = -60.0
# Sound so far below the level of speech, or below full scale, is noise.
GATE_DB, FLOOR_DB = 25.0, -65.0
# The gain leads the level of speech here, within limits, so fast.
TARGET_LEVEL_DB = -22.0
MIN_GAIN_DB, MAX_GAIN_DB, GAIN_STEP_DB = -12.0, 20.0, 0.25
PEAK = 0.9 * FULL_SCALE


@dataclass(frozen=True, slots=True)
class GatedFrame:
    """A frame of sound with the gain applied, (n,) int16; is_speech: it is worth sending."""

    samples: Samples
    is_speech: bool


class SpeechGate:
    """Processes the successive frames of one voice.

    rate_hz: 8000 or 16000.
    """

    def __init__(self, rate_hz: int) -> None:
        import webrtcvad

        self._rate_hz, self._vad = rate_hz, webrtcvad.Vad(VAD_MODE)
        self._level_db, self._gain_db, self._gain = INITIAL_LEVEL_DB, 0.0, 1.0

    def process(self, samples: Samples) -> GatedFrame:
        """The next frame, (n,) int16: a whole number of hundredths of a second."""
        is_speech = self._is_speech(samples)
        if is_speech:
            wanted = np.clip(TARGET_LEVEL_DB - self._level_db, MIN_GAIN_DB, MAX_GAIN_DB)
            step = np.clip(wanted - self._gain_db, -GAIN_STEP_DB, GAIN_STEP_DB)
            self._gain_db += float(step)
        return GatedFrame(self._amplified(samples), is_speech)

    def _is_speech(self, samples: Samples) -> bool:
        piece = self._rate_hz // VAD_FRAMES_PER_SECOND
        pieces = samples.reshape(-1, piece)
        # Each piece is shown to the detector, which learns the noise.
        found = [self._vad.is_speech(each.tobytes(), self._rate_hz) for each in pieces]
        level_db = level(samples)
        if level_db > self._level_db:
            self._level_db += LEVEL_RISE * (level_db - self._level_db)
        else:
            self._level_db -= LEVEL_FALL_DB
        return any(found) and level_db > max(self._level_db - GATE_DB, FLOOR_DB)

    def _amplified(self, samples: Samples) -> Samples:
        """With the gain, which changes steadily over the frame; the limit of the peak holds."""
        peak = max(float(np.abs(samples.astype(np.float64)).max(initial=0.0)), 1.0)
        gain = min(10 ** (self._gain_db / 20), PEAK / peak)
        ramp = np.linspace(self._gain, gain, len(samples))
        self._gain = gain
        return np.clip(np.rint(samples * ramp), -FULL_SCALE, FULL_SCALE - 1).astype(np.int16)


def level(samples: Samples) -> float:
    """RMS of samples in decibels of full scale, at least -120."""
    power = float(np.mean(np.square(samples / FULL_SCALE))) if len(samples) else 0.0
    return 10 * float(np.log10(max(power, 1e-12)))


class SpeechSource(Protocol):
    """Gives the speech frames of a call in order, from frame 0 on; None: a silent one.

    voice: the codec, one of `VOICES`.
    """

    @property
    def voice(self) -> str: ...

    def take(self, end: int) -> list[bytes | None]:
        """The frames before number `end` that have not been taken and are there."""


class SpeechCoder:
    """Codes the samples of one voice.

    look_ahead: also send the frame before speech, in which its beginning may hide; every frame then
        comes 40 ms later.
    """

    def __init__(self, encoder: SpeechEncoder, look_ahead: bool) -> None:
        self._encoder, self._look_ahead = encoder, look_ahead
        self._gate = SpeechGate(encoder.rate_hz)
        self._size = encoder.rate_hz // SPEECH_FRAMES_PER_SECOND
        self._pending = np.zeros(0, np.int16)  # not a whole frame yet
        # Gated samples from the next frame to code on, and which of their frames are speech.
        self._gated = np.zeros(0, np.int16)
        self._speech = deque[bool]()
        self._was_speech = self._was_sent = False

    def push(self, samples: Samples) -> Iterator[bytes | None]:
        """The frames that are complete with more samples, (n,) int16; all must be consumed."""
        self._pending = np.concatenate([self._pending, samples])
        while len(self._pending) >= self._size:
            frame = self._gate.process(self._pending[: self._size])
            self._pending = self._pending[self._size :]
            self._gated = np.concatenate([self._gated, frame.samples])
            self._speech.append(frame.is_speech)
            yield from self._code(self._size + self._encoder.delay)

    def finish(self) -> Iterator[bytes | None]:
        """The frames that remain, as if silence followed."""
        silence = np.zeros(3 * self._size, np.int16)
        count = len(self._speech) + bool(len(self._pending))
        for _, frame in zip(range(count), self.push(silence), strict=False):
            yield frame

    def _code(self, needed: int) -> Iterator[bytes | None]:
        """Code the frames that can be: a frame also needs the samples of the codec's delay."""
        while len(self._gated) >= needed and len(self._speech) > self._look_ahead:
            is_speech = self._speech.popleft()
            follows = self._look_ahead and self._speech[0]
            # One frame more after speech, in which it dies away.
            is_sent = is_speech or self._was_speech or follows
            yield self._coded(is_sent)
            self._was_speech, self._was_sent = is_speech, is_sent
            self._gated = self._gated[self._size :]

    def _coded(self, is_sent: bool) -> bytes | None:
        if not is_sent:
            return None
        if not self._was_sent:
            self._encoder.restart()
        delay = self._encoder.delay
        return self._encoder.encode(self._gated[delay : delay + self._size])
