"""Encoder, gate and decoder of the voice, without packets around them."""

from pathlib import Path

import numpy as np

from decoder.sound.call_speech import CallSpeech
from decoder.sound.speech_decoder import open_speech_decoder
from decoder.sound.speech_frames import SpeechFrames
from decoder.sound.voice_decoder import VoiceDecoder
from encoder.sound.recorded_speech import RecordedSpeech
from encoder.sound.sound_file import read_sound
from loopback.quality.intelligibility import RATE_HZ, aligned, estoi, resampled
from protocol.voice.voice_block import serialise_frames

# More frames than any file has.
ALL = 1 << 40


def measure(path: Path, voice: str) -> tuple[float, float]:
    """ESTOI, and bits a second, of the sound of a file in one codec."""
    frames = RecordedSpeech(path, voice).take(ALL)
    received = SpeechFrames()
    received.add(0, 0, tuple(frames))
    decoder = VoiceDecoder(CallSpeech(received), open_speech_decoder(voice))
    sound = np.concatenate([decoder.decode_next() for _ in frames]).astype(np.float64)
    source = np.concatenate(list(read_sound(path, RATE_HZ))).astype(np.float64)
    decoded = resampled(sound, decoder.rate_hz, RATE_HZ)
    bits = 8 * len(serialise_frames(voice, [frame for frame in frames if frame]))
    return estoi(*aligned(source, decoded, RATE_HZ)), bits * RATE_HZ / len(source)
