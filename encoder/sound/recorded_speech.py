"""The voice of a recorded source: speech frames of a file's sound track, as the options ask for
them and the host can code them."""

from collections.abc import Iterator
from pathlib import Path

from encoder.sound.sound_file import Warn, has_sound, read_sound
from encoder.sound.speech_coder import SpeechCoder
from encoder.sound.speech_encoder import open_speech_encoder, voice_is_installed
from encoder.sound.voice_packer import VoicePacker
from protocol.limits import USUAL_VOICE


class RecordedSpeech:
    """The speech of the first sound track of a file or URL: a `SpeechSource`.

    warn: see `read_sound`.  Raises `UserError` if the codec is not installed.
    """

    def __init__(self, source: str | Path, voice: str, warn: Warn = lambda line: None) -> None:
        self.voice = voice
        self._encoder = open_speech_encoder(voice)
        self._frames = self._coded(source, warn)
        self._count = 0

    def take(self, end: int) -> list[bytes | None]:
        """See `SpeechSource`."""
        taken = [frame for _, frame in zip(range(end - self._count), self._frames, strict=False)]
        self._count += len(taken)
        return taken

    def _coded(self, source: str | Path, warn: Warn) -> Iterator[bytes | None]:
        coder = SpeechCoder(self._encoder, look_ahead=True)
        for samples in read_sound(source, self._encoder.rate_hz, warn):
            yield from coder.push(samples)
        yield from coder.finish()


def chosen_voice(source: str, asked: str | None) -> tuple[str, str | None]:
    """The codec for a source, one of `VOICES`, and a warning if it is not what one may expect.

    asked: one of `VOICES`; None: the usual one where there is sound and the codec is installed.
    """
    if asked == "off":
        return "off", None
    if not has_sound(source):
        return "off", None if asked is None else f"{source} has no sound: the call has no voice"
    if asked is None and not voice_is_installed(USUAL_VOICE):
        return "off", "the sound is left out: pip install '.[voice]' to send it"
    return asked or USUAL_VOICE, None


def open_voice(source: str, voice: str, warn: Warn = lambda line: None) -> VoicePacker | None:
    """What adds the voice of a source to its packets; None for "off".

    warn: see `read_sound`.  Raises `UserError` if the codec is not installed.
    """
    return None if voice == "off" else VoicePacker(RecordedSpeech(source, voice, warn))
