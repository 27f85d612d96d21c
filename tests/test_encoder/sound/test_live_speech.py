"""The voice of a microphone: where its times say, whatever its clock does."""

import numpy as np
import pytest

from shared_model.arrays import Samples

pytest.importorskip("pycodec2", reason="needs pycodec2: pip install '.[voice]'")
pytest.importorskip("webrtcvad", reason="needs webrtcvad: pip install '.[voice]'")

from encoder.sound.live_speech import MAX_LATE_FRAMES, LiveSpeech

START_S, PIECE_S, RATE_HZ = 100.0, 0.02, 8000


def buzz(begin_s: float, end_s: float) -> Samples:
    """A voiced sound between two times, silence elsewhere; four seconds."""
    time_s = np.arange(4 * RATE_HZ) / RATE_HZ
    wave = sum(np.sin(2 * np.pi * 120 * k * time_s) / k for k in range(1, 25))
    wave = wave * (0.6 + 0.4 * np.sin(2 * np.pi * 4 * time_s))
    return np.asarray(5000 * wave * ((begin_s <= time_s) & (time_s < end_s)), np.int16)


def spoken(speech: LiveSpeech, sound: Samples, clock: float = 1.0) -> list[int]:
    """The numbers of the frames that are spoken, if the sound card's second takes `clock` s."""
    size, frames = round(PIECE_S * RATE_HZ), list[bytes | None]()
    for first in range(0, len(sound), size):
        time_s = first / RATE_HZ * clock
        speech.push(sound[first : first + size], START_S + time_s)
        frames += speech.take(int(25 * time_s))
    return [number for number, frame in enumerate(frames) if frame is not None]


def test_speech_is_where_it_was_spoken() -> None:
    numbers = spoken(LiveSpeech("1200", lambda: START_S), buzz(1.0, 2.0))
    assert numbers == list(range(numbers[0], numbers[-1] + 1))
    assert numbers[0] == pytest.approx(25, abs=1) and numbers[-1] == pytest.approx(50, abs=2)


def test_sound_from_before_the_call_is_left_out() -> None:
    speech = LiveSpeech("1200", lambda: START_S + 0.5)
    numbers = spoken(speech, buzz(1.0, 2.0))
    assert numbers[0] == pytest.approx(12.5, abs=2) and numbers[-1] == pytest.approx(37.5, abs=2)


@pytest.mark.parametrize("clock", [0.9, 1.1])
def test_a_clock_that_is_wrong_does_not_move_the_speech(clock: float) -> None:
    numbers = spoken(LiveSpeech("1200", lambda: START_S), buzz(2.8, 3.8), clock)
    assert numbers[0] == pytest.approx(25 * 2.8 * clock, abs=2)


def test_a_microphone_that_gives_nothing_is_silent_and_the_call_goes_on() -> None:
    speech = LiveSpeech("1200", lambda: START_S)
    assert speech.take(100) == [None] * (100 - MAX_LATE_FRAMES - 1)
    sound = buzz(0.0, 4.0)[: RATE_HZ // 2]
    speech.push(sound, START_S + 100 / 25)
    frames = speech.take(112)
    assert any(frame is not None for frame in frames)


def test_before_the_call_begins_nothing_is_spoken() -> None:
    speech = LiveSpeech("1200", lambda: None)
    speech.push(buzz(0.0, 4.0), START_S)
    assert speech.take(50) == []
