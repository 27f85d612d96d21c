"""The voice of a recorded source: speech frames of a file's sound track."""

from collections.abc import Iterator
from pathlib import Path

from encoder.sound.sound_file import Warn, read_sound
from encoder.sound.speech_coder import SpeechCoder
from encoder.sound.speech_encoder import open_speech_encoder


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
