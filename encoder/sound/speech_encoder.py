"""Codecs of speech, sending side: frames of 40 ms in, their bytes out."""

from importlib.util import find_spec
from typing import Protocol

import av
import numpy as np
from av.audio.codeccontext import AudioCodecContext

from protocol.voice.voice_block import CODEC2_MODES, CODEC2_RATE_HZ, SPEECH_FRAMES_PER_SECOND
from shared_model.arrays import Samples
from shared_model.errors import UserError

OPUS_RATE_HZ = 16000
OPUS_BPS = 6000
# By how many samples the decoded sound comes later than what was encoded.
CODEC2_DELAY = {"700C": 240, "1200": 160}
OPUS_DELAY = 104


class SpeechEncoder(Protocol):
    """Encodes the successive frames of one voice.

    rate_hz: samples per second.  delay: of the decoded sound, samples.
    """

    @property
    def rate_hz(self) -> int: ...

    @property
    def delay(self) -> int: ...

    def encode(self, samples: Samples) -> bytes:
        """The bytes of the next frame, (rate_hz / 25,) int16."""

    def restart(self) -> None:
        """Forget what came before: the frame that comes next follows on silence."""


def voice_is_installed(voice: str) -> bool:
    """Whether this host has what encoding the voice takes."""
    modules = ["webrtcvad"] if voice == "opus" else ["webrtcvad", "pycodec2"]
    return all(find_spec(module) for module in modules)


def speech_rate_hz(voice: str) -> int:
    """Samples per second that a codec of `VOICES` takes."""
    return OPUS_RATE_HZ if voice == "opus" else CODEC2_RATE_HZ


def open_speech_encoder(voice: str) -> SpeechEncoder:
    """The encoder of a codec of `VOICES`.  Raises `UserError` if it is not installed."""
    if not voice_is_installed(voice):
        raise UserError(
            f"the voice ({voice}) is not installed: pip install '.[voice]', or --voice off"
        )
    return OpusEncoder() if voice == "opus" else Codec2Encoder(voice)


class Codec2Encoder:
    """Codec2, 700C or 1200: a `SpeechEncoder`."""

    rate_hz = CODEC2_RATE_HZ

    def __init__(self, voice: str) -> None:
        self._voice = voice
        self.delay = CODEC2_DELAY[voice]
        self.restart()

    def encode(self, samples: Samples) -> bytes:
        """See `SpeechEncoder`."""
        return bytes(self._codec.encode(np.ascontiguousarray(samples, np.int16)))

    def restart(self) -> None:
        """See `SpeechEncoder`: the decoder starts anew there, too."""
        import pycodec2

        self._codec = pycodec2.Codec2(CODEC2_MODES[self._voice])


class OpusEncoder:
    """Opus at 6 kbit/s: a `SpeechEncoder`."""

    rate_hz, delay = OPUS_RATE_HZ, OPUS_DELAY

    def __init__(self) -> None:
        context = av.CodecContext.create("libopus", "w")
        assert isinstance(context, AudioCodecContext)
        context.sample_rate, context.layout, context.format = self.rate_hz, "mono", "s16"
        context.bit_rate = OPUS_BPS
        context.options = {"application": "voip", "frame_duration": "40", "vbr": "on"}
        context.open()
        self._context, self._count = context, 0

    def encode(self, samples: Samples) -> bytes:
        """See `SpeechEncoder`."""
        frame = av.AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate, frame.pts = self.rate_hz, self._count
        self._count += self.rate_hz // SPEECH_FRAMES_PER_SECOND
        (packet,) = self._context.encode(frame)
        return bytes(packet)

    def restart(self) -> None:
        """See `SpeechEncoder`: Opus goes on, its decoder bridges what is not sent."""
