"""ESTOI: 1 for the same speech, less the more noise is in it, whatever the level and the delay."""

import numpy as np
import pytest
from sounds import voiced_sound

from loopback.quality.intelligibility import RATE_HZ, aligned, estoi, resampled

SPEECH = voiced_sound(3 * RATE_HZ, RATE_HZ).astype(np.float64)


def test_the_same_speech_at_another_level_is_intelligible() -> None:
    assert estoi(SPEECH, 0.1 * SPEECH) == pytest.approx(1)


def test_noise_makes_speech_less_intelligible() -> None:
    noise = np.random.default_rng(1).normal(size=len(SPEECH))
    found = [estoi(SPEECH, SPEECH + level * noise) for level in (0, 300, 1000, 3000, 10000)]
    assert all(np.diff(found) < 0) and found[-1] < 0.2


def test_silence_in_the_source_does_not_count() -> None:
    noise = 500 * np.random.default_rng(1).normal(size=len(SPEECH))
    with_pause = np.concatenate([SPEECH, np.zeros(2 * RATE_HZ)])
    pause = np.concatenate([SPEECH + noise, 100 * np.ones(2 * RATE_HZ)])
    assert estoi(with_pause, pause) == pytest.approx(estoi(SPEECH, SPEECH + noise), abs=0.02)


def test_too_little_speech_and_other_lengths_are_refused() -> None:
    with pytest.raises(ValueError, match="frames of speech"):
        estoi(SPEECH[:3000], SPEECH[:3000])
    with pytest.raises(ValueError, match="expected the reference's"):
        estoi(SPEECH, SPEECH[1:])


@pytest.mark.parametrize("late", [-1500, 0, 50, 2000])
def test_a_delay_is_taken_out(late: int) -> None:
    loudness = np.repeat(np.random.default_rng(2).random(60), len(SPEECH) // 60)
    speech = SPEECH * loudness
    moved = np.concatenate([np.zeros(max(late, 0)), speech[max(-late, 0) :]])
    reference, decoded = aligned(speech, moved, RATE_HZ)
    assert len(reference) > len(speech) - abs(late) - 100
    np.testing.assert_array_equal(reference, decoded)


@pytest.mark.parametrize("rate_hz", [8000, 10_000, 48_000])
def test_another_rate_keeps_the_tone(rate_hz: int) -> None:
    tone = np.sin(2 * np.pi * 440 * np.arange(rate_hz) / rate_hz)
    expected = np.sin(2 * np.pi * 440 * np.arange(RATE_HZ) / RATE_HZ)
    assert np.abs(resampled(tone, rate_hz, RATE_HZ) - expected).max() < 1e-6
