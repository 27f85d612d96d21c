"""A microphone of this host, through the library `sounddevice`."""

import time
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from encoder.sound.live_speech import PIECE_S
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
