"""The sound of a video file as a microphone would give it: each piece when it has been spoken."""

import time
from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread

import numpy as np

from encoder.sound.live_speech import PIECE_S
from encoder.sound.sound_file import read_sound
from shared_model.arrays import Samples


class FileMicrophone:
    """Plays the sound track of a file from its beginning, once for each call of `start`.

    push: takes samples, (n,) int16 at `rate_hz`, and the time of the first one.
    """

    def __init__(self, path: Path, rate_hz: int, push: Callable[[Samples, float], None]) -> None:
        self._path, self._rate_hz, self._push = path, rate_hz, push
        self._stopped, self._thread = Event(), Thread()

    def start(self, start_s: float) -> None:
        """Play from the beginning, which is at this time of `time.monotonic`."""
        self.stop()
        self._stopped = Event()
        self._thread = Thread(target=self._play, args=(start_s, self._stopped), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop playing."""
        self._stopped.set()
        if self._thread.is_alive():
            self._thread.join()

    def _play(self, start_s: float, stopped: Event) -> None:
        size, position = round(PIECE_S * self._rate_hz), 0
        rest = np.zeros(0, np.int16)
        for samples in read_sound(self._path, self._rate_hz):
            rest = np.concatenate([rest, samples])
            while len(rest) >= size:
                time_s = start_s + position / self._rate_hz
                if stopped.wait(max(0.0, time_s + PIECE_S - time.monotonic())):
                    return
                self._push(rest[:size], time_s)
                rest, position = rest[size:], position + size
