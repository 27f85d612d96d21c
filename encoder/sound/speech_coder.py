"""From a stream of samples to speech frames: gate, then codec; what is silent is not sent."""

from collections import deque
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from encoder.sound.speech_encoder import SpeechEncoder
from encoder.sound.speech_gate import SpeechGate
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND
from shared_model.arrays import Samples


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
        """Code what can be: a frame takes as many samples of those after it as its delay."""
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
