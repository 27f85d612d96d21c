"""Codecs of speech, receiving side: bytes in, frames of 40 ms out, also in place of lost ones."""

from contextlib import suppress
from importlib.util import find_spec
from typing import Protocol

import av
import numpy as np
from av.audio.codeccontext import AudioCodecContext

from protocol.errors import ProtocolError
from protocol.voice.voice_block import CODEC2_MODES, CODEC2_RATE_HZ, SPEECH_FRAMES_PER_SECOND
from shared_model.arrays import Samples

# Opus decodes at its own rate, whatever that of the encoder is.
OPUS_OUTPUT_RATE_HZ = 48000
# The part of Opus' first byte that a packet without frames has in common with the one before it.
_OPUS_CONFIGURATION = 0xFC


class SpeechDecoder(Protocol):
    """Decodes the successive frames of one voice.

    rate_hz: samples per second.
    """

    @property
    def rate_hz(self) -> int: ...

    def decode(self, frame: bytes) -> Samples:
        """The sound of the next frame, (rate_hz / 25,) int16.

        Raises `ProtocolError` if the codec refuses the frame.
        """

    def conceal(self) -> Samples:
        """Sound in place of a missing frame, like that of the frame before."""

    def restart(self) -> None:
        """Forget what came before: the frame that comes next follows on silence."""


def voice_is_decodable(voice: str) -> bool:
    """Whether this host has what decoding a codec of `VOICES` takes."""
    return voice == "opus" or find_spec("pycodec2") is not None


def open_speech_decoder(voice: str) -> SpeechDecoder:
    """The decoder of a codec of `VOICES` that is decodable here."""
    return OpusDecoder() if voice == "opus" else Codec2Decoder(voice)


class Codec2Decoder:
    """Codec2, 700C or 1200: a `SpeechDecoder`."""

    rate_hz = CODEC2_RATE_HZ

    def __init__(self, voice: str) -> None:
        self._voice = voice
        self._last: bytes | None = None
        self.restart()

    def decode(self, frame: bytes) -> Samples:
        """See `SpeechDecoder`."""
        self._last = frame
        return np.asarray(self._codec.decode(frame), np.int16)

    def conceal(self) -> Samples:
        """See `SpeechDecoder`: the frame before, once more."""
        if self._last is None:
            return np.zeros(self.rate_hz // SPEECH_FRAMES_PER_SECOND, np.int16)
        return np.asarray(self._codec.decode(self._last), np.int16)

    def restart(self) -> None:
        """See `SpeechDecoder`."""
        import pycodec2

        self._codec = pycodec2.Codec2(CODEC2_MODES[self._voice])


class OpusDecoder:
    """Opus: a `SpeechDecoder`."""

    rate_hz = OPUS_OUTPUT_RATE_HZ

    def __init__(self) -> None:
        context = av.CodecContext.create("libopus", "r")
        assert isinstance(context, AudioCodecContext)
        context.sample_rate, context.layout = self.rate_hz, "mono"
        self._context = context
        self._configuration: int | None = None

    def decode(self, frame: bytes) -> Samples:
        """See `SpeechDecoder`."""
        try:
            samples = self._decoded(frame)
        except av.FFmpegError as error:
            raise ProtocolError(f"Opus frame: {error.strerror}") from error
        if len(samples) != self.rate_hz // SPEECH_FRAMES_PER_SECOND:
            raise ProtocolError(f"Opus frame of {len(samples)} samples, expected 40 ms")
        self._configuration = frame[0] & _OPUS_CONFIGURATION
        return samples

    def conceal(self) -> Samples:
        """See `SpeechDecoder`: what libopus makes of a packet without frames.

        Where the frames of the call's packets are shorter than 40 ms that is one of those; silence
        follows on it.
        """
        samples = np.zeros(self.rate_hz // SPEECH_FRAMES_PER_SECOND, np.int16)
        if self._configuration is not None:
            with suppress(av.FFmpegError):
                made = self._decoded(bytes([self._configuration]))[: len(samples)]
                samples[: len(made)] = made
        return samples

    def restart(self) -> None:
        """See `SpeechDecoder`: Opus goes on."""

    def _decoded(self, frame: bytes) -> Samples:
        pieces = [each.to_ndarray().reshape(-1) for each in self._context.decode(av.Packet(frame))]
        return np.concatenate([np.zeros(0, np.int16), *pieces]).astype(np.int16)
