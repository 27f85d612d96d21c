"""From speech frames to sound: decoded in order; what is missing or silent fades out."""

import numpy as np

from decoder.sound.speech_decoder import SpeechDecoder
from decoder.sound.speech_frames import CallSpeech
from protocol.errors import ProtocolError
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND
from shared_model.arrays import Samples

# Gain of a frame that repeats the one before it, and below which nothing is left of it.
FADE, INAUDIBLE = 0.7, 0.05


class VoiceDecoder:
    """Decodes the frames of one voice in order, each once.

    next_frame: number of the frame to be decoded next.
    damaged: number of frames that the codec refused.
    """

    def __init__(self, speech: CallSpeech, decoder: SpeechDecoder) -> None:
        self._speech, self._decoder = speech, decoder
        self._gain, self._follows_silence = 0.0, True
        self.next_frame = self.damaged = 0

    @property
    def rate_hz(self) -> int:
        """Samples per second."""
        return self._decoder.rate_hz

    @property
    def frame_samples(self) -> int:
        """Samples in a frame."""
        return self.rate_hz // SPEECH_FRAMES_PER_SECOND

    def skip_to(self, index: int) -> None:
        """Go on with frame `index`."""
        self.next_frame, self._follows_silence = index, True
        self._speech.drop_before(index)

    def decode_next(self) -> Samples:
        """The sound of the next frame, int16."""
        frame = self._speech.get(self.next_frame)
        self.next_frame += 1
        self._speech.drop_before(self.next_frame)
        if frame:
            return self._decoded(frame)
        self._follows_silence |= frame is not None
        return self._faded()

    def _decoded(self, frame: bytes) -> Samples:
        if self._follows_silence:
            self._decoder.restart()
        try:
            samples = self._decoder.decode(frame)
        except ProtocolError:
            self.damaged += 1
            return self._faded()
        self._gain, self._follows_silence = 1.0, False
        return samples

    def _faded(self) -> Samples:
        """Like the frame before, and quieter."""
        if not self._gain:
            return np.zeros(self.frame_samples, np.int16)
        gain = self._gain * FADE if self._gain * FADE > INAUDIBLE else 0.0
        ramp = np.linspace(self._gain, gain, self.frame_samples)
        self._gain = gain
        return np.asarray(self._decoder.conceal() * ramp, np.int16)
