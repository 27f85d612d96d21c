"""Microphones of a call: of this host, through the library `sounddevice`, or a sound file."""

import time
from collections.abc import Callable
from pathlib import Path
from threading import Event, Thread
from typing import Any, Protocol

import numpy as np

from encoder.sound.live_speech import PIECE_S
from encoder.sound.sound_file import read_sound
from shared_model.arrays import Samples
from shared_model.errors import UserError


class OpenMicrophone(Protocol):
    """A microphone that gives sound until it is closed."""

    def close(self) -> None:
        """Release the device."""


def open_host_microphone(
    name: str, rate_hz: int, push: Callable[[Samples, float], None]
) -> OpenMicrophone:
    """Open a microphone; it gives samples, (n,) int16, and the time of the first one.

    name: "default", or a number or a part of a name as `python -m sounddevice` lists them.
    push: called in a thread of its own; times are those of `time.monotonic`.
    Raises `UserError` if the library is not installed or the device does not open.
    """
    try:
        import sounddevice
    except (ImportError, OSError) as error:
        raise UserError(
            f"no microphone ({error}): pip install '.[microphone]', and the system's"
            " library PortAudio (Debian: libportaudio2)"
        ) from error

    def heard(data: Any, count: int, times: Any, status: Any) -> None:
        delay_s = max(0.0, times.currentTime - times.inputBufferAdcTime)
        push(np.frombuffer(bytes(data), np.int16), time.monotonic() - delay_s)

    device: int | str | None = int(name) if name.isdecimal() else name
    try:
        stream = sounddevice.RawInputStream(
            samplerate=rate_hz,
            blocksize=round(PIECE_S * rate_hz),
            device=None if device == "default" else device,
            channels=1,
            dtype="int16",
            callback=heard,
        )
        stream.start()
    except (sounddevice.PortAudioError, ValueError) as error:
        raise UserError(f"microphone {name} does not open: {error}") from error
    opened: OpenMicrophone = stream
    return opened


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
