"""Sounds like speech, made by the tests."""

import wave
from pathlib import Path

import numpy as np

from shared_model.arrays import Samples


def voiced_sound(count: int, rate_hz: int = 8000) -> Samples:
    """A buzz of 120 Hz whose loudness follows syllables, (count,) int16."""
    time_s = np.arange(count) / rate_hz
    buzz = sum(np.sin(2 * np.pi * 120 * k * time_s) / k for k in range(1, 25))
    return np.asarray(5000 * buzz * (0.6 + 0.4 * np.sin(2 * np.pi * 4 * time_s)), np.int16)


def write_wave(path: Path, samples: Samples, rate_hz: int) -> None:
    """Write samples, (n,) int16, as a WAV file."""
    with wave.open(str(path), "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(rate_hz)
        file.writeframes(samples.tobytes())
