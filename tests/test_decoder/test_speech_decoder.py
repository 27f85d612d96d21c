"""What stands in for speech frames that are missing."""

from collections.abc import Callable

import av
import numpy as np
import pytest
from av.audio.codeccontext import AudioCodecContext
from sounds import voiced_sound

from decoder.sound.speech_decoder import OPUS_OUTPUT_RATE_HZ, OpusDecoder
from decoder.sound.speech_frames import CallSpeech, SpeechFrames
from decoder.sound.voice_decoder import VoiceDecoder
from encoder.sound.speech_encoder import OPUS_RATE_HZ, OpusEncoder

SAMPLES = OPUS_OUTPUT_RATE_HZ // 25


def frame_of_40_ms() -> bytes:
    """What the encoder makes of speech."""
    return OpusEncoder().encode(voiced_sound(OPUS_RATE_HZ // 25, OPUS_RATE_HZ))


def two_frames_of_20_ms() -> bytes:
    """Another division of 40 ms: two frames of the same size in a packet (RFC 6716, 3.2.3)."""
    context = av.CodecContext.create("libopus", "w")
    assert isinstance(context, AudioCodecContext)
    context.sample_rate, context.layout, context.format = OPUS_RATE_HZ, "mono", "s16"
    context.options = {"application": "voip", "frame_duration": "20"}
    context.open()
    samples = voiced_sound(OPUS_RATE_HZ // 50, OPUS_RATE_HZ).reshape(1, -1)
    frame = av.AudioFrame.from_ndarray(samples, format="s16", layout="mono")
    frame.sample_rate = OPUS_RATE_HZ
    data = bytes(context.encode(frame)[0])
    return bytes([data[0] | 1]) + 2 * data[1:]


@pytest.mark.parametrize("make", [frame_of_40_ms, two_frames_of_20_ms])
def test_a_missing_frame_is_like_the_one_before_and_quieter(make: Callable[[], bytes]) -> None:
    speech = SpeechFrames()
    speech.add(0, 0, (make(), make()))
    decoder = VoiceDecoder(CallSpeech(speech), OpusDecoder())
    heard = [decoder.decode_next() for _ in range(20)]
    assert decoder.damaged == 0 and {len(each) for each in heard} == {SAMPLES}
    loudness = [float(each.astype(float).std()) for each in heard]
    assert loudness[1] > loudness[2] > 0 and loudness[-1] == 0


def test_a_silence_of_days_takes_no_memory() -> None:
    speech, days = SpeechFrames(), 10**8
    speech.add(0, 0, (b"a",))
    speech.add(1, days, (b"b",))
    assert [speech.get(index) for index in (0, 1, days - 1, days, days + 1)] == [
        b"a",
        b"",
        b"",
        b"b",
        None,
    ]
    speech.drop_before(days)
    assert speech.get(days - 1) is None and speech.get(days) == b"b"


def test_nothing_stands_in_for_a_frame_before_the_first() -> None:
    assert np.array_equal(OpusDecoder().conceal(), np.zeros(SAMPLES, np.int16))
