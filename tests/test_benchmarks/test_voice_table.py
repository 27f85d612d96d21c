"""The table of the voice's codecs."""

from pathlib import Path

import numpy as np
import pytest
from sounds import write_wave

from benchmarks.voice_table import main, measure
from shared_model.arrays import Samples
from shared_model.errors import UserError


def vowels(count: int, rate_hz: int) -> Samples:
    """Harmonics of 120 Hz under two formants that wander, (count,) int16."""
    time_s = np.arange(count) / rate_hz
    formants_hz = 600 + 300 * np.sin(8 * time_s), 1700 + 600 * np.sin(5 * time_s)
    sound = np.zeros(count)
    for k in range(1, 30):
        gain = sum(np.exp(-(((120 * k - at) / 150) ** 2)) for at in formants_hz)
        sound += gain * np.sin(2 * np.pi * 120 * k * time_s)
    return np.asarray(4000 * sound, np.int16)


def test_opus_keeps_vowels_intelligible(tmp_path: Path) -> None:
    path = tmp_path / "speech.wav"
    write_wave(path, vowels(3 * 16000, 16000), 16000)
    intelligibility, rate_bps = measure(path, "opus")
    assert intelligibility > 0.6 and 1000 < rate_bps < 10_000


def test_a_file_without_sound_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.txt"
    path.write_text("no sound")
    with pytest.raises(UserError, match="has no sound"):
        main([str(path)])
