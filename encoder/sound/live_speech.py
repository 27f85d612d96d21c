"""The voice of a microphone, on the clock of the camera, which runs beside that of the sound."""

from collections import deque
from collections.abc import Callable
from threading import Lock

from encoder.sound.drift_compensator import DriftCompensator
from encoder.sound.speech_coder import SpeechCoder
from encoder.sound.speech_encoder import open_speech_encoder
from protocol.voice.voice_block import SPEECH_FRAMES_PER_SECOND
from shared_model.arrays import Samples

# Sound that is so much late is not waited for: silence stands in its place.
MAX_LATE_FRAMES = 12
# Length of a piece of sound, as a sound card gives them.
PIECE_S = 0.02
# Pieces that may wait for the call to begin.
MAX_PIECES = 100


class LiveSpeech:
    """The speech of a microphone: a `SpeechSource`.

    start_s: tells when source frame 0 was taken; None: not yet.  Sound from before is left out.
    The clock of the sound may run faster or slower than that of `start_s`: the sound is stretched
    or shrunk, and put where its time says if it is further away, see `DriftCompensator`.
    Raises `UserError` if the codec is not installed.
    """

    def __init__(self, voice: str, start_s: Callable[[], float | None]) -> None:
        self.voice = voice
        encoder = open_speech_encoder(voice)
        self._coder, self.rate_hz = SpeechCoder(encoder, look_ahead=False), encoder.rate_hz
        self._frame_samples = self.rate_hz // SPEECH_FRAMES_PER_SECOND
        self._start_s = start_s
        self._lock, self._pieces = Lock(), deque[tuple[float, Samples]](maxlen=MAX_PIECES)
        self._clock = DriftCompensator(self.rate_hz)
        self._coded = deque[bytes | None]()
        self._count = 0  # frames taken

    def push(self, samples: Samples, time_s: float) -> None:
        """Add samples, (n,) int16 at `rate_hz`; time_s: of the first one, as `start_s` counts."""
        with self._lock:
            self._pieces.append((time_s, samples))

    def take(self, end: int) -> list[bytes | None]:
        """See `SpeechSource`."""
        start_s = self._start_s()
        if start_s is None:
            return []
        for time_s, samples in self._waiting():
            self._code(self._clock.put(samples, (time_s - start_s) * self.rate_hz))
        self._code(self._clock.fill((end - MAX_LATE_FRAMES) * self._frame_samples))
        taken = [self._coded.popleft() for _ in range(min(end - self._count, len(self._coded)))]
        self._count += len(taken)
        return taken

    def _waiting(self) -> list[tuple[float, Samples]]:
        with self._lock:
            pieces = list(self._pieces)
            self._pieces.clear()
        return pieces

    def _code(self, samples: Samples) -> None:
        self._coded.extend(self._coder.push(samples))
