"""The voice of a recorded source: speech frames of a file's sound track."""

from collections.abc import Iterator
from pathlib import Path

from encoder.sound.sound_file import read_sound
from encoder.sound.speech_coder import SpeechCoder
from encoder.sound.speech_encoder import open_speech_encoder


class RecordedSpeech:
    """The speech of the first sound track of a file: a `SpeechSource`.

    Raises `UserError` if the codec is not installed.
    """

    def __init__(self, path: Path, voice: str) -> None:
        self.voice = voice
        self._encoder = open_speech_encoder(voice)
        self._frames = self._coded(path)
        self._count = 0

    def take(self, end: int) -> list[bytes | None]:
        """See `SpeechSource`."""
        taken = [frame for _, frame in zip(range(end - self._count), self._frames, strict=False)]
        self._count += len(taken)
        return taken

    def _coded(self, path: Path) -> Iterator[bytes | None]:
        coder = SpeechCoder(self._encoder, look_ahead=True)
        for samples in read_sound(path, self._encoder.rate_hz):
            yield from coder.push(samples)
        yield from coder.finish()
