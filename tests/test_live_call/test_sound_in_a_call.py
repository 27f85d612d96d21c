"""Sound of a call is sent to the page as soon as it has come, and silence is not waited for."""

import numpy as np

from decoder.sound.speech_frames import SpeechFrames
from risorius.live_call.drawing_worker import leading_silence


def test_speech_is_there_when_its_packet_has_come() -> None:
    speech = SpeechFrames()
    speech.add(0, 0, (b"a", b"b", None, b"d"))
    assert speech.received_until == 4
    speech.add(1, 8, (b"e",))
    assert speech.received_until == 9
    assert [speech.get(index) for index in (2, 5, 8)] == [b"", b"", b"e"]


def test_silence_in_front_is_found() -> None:
    samples = np.array([0, 12, -20, 900, 0, -900], np.int16)
    assert leading_silence(samples) == 3
    assert leading_silence(np.zeros(5, np.int16)) == 5
    assert leading_silence(np.array([-32768, 0], np.int16)) == 0
