"""A decoded voice beside its source: how intelligible it is, how good, and how late."""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from encoder.sound.sound_file import has_sound, read_sound
from loopback.judge.observer import MediaPipeJudge, Observer
from loopback.judge.programs import run_program
from loopback.quality.intelligibility import RATE_HZ, aligned, delay_s, estoi
from loopback.report import rounded
from shared_model.arrays import Array

DNSMOS_RATE_HZ = 16_000
# Full scale of the samples that are read.
FULL_SCALE = 32768.0


@dataclass(frozen=True, slots=True)
class VoiceQuality:
    """A figure is None if it cannot be measured.

    voice_estoi: intelligibility after alignment, see `estoi`.
    voice_late_ms: by how much the decoded sound comes later than the source's; negative: earlier.
    voice_dnsmos, source_dnsmos: DNSMOS P.835, overall, 1 to 5, of both; only where a judge is.
    """

    voice_estoi: float | None = None
    voice_late_ms: float | None = None
    voice_dnsmos: float | None = None
    source_dnsmos: float | None = None


def compare_voices(source: str, decoded: str, observer: Observer) -> VoiceQuality:
    """Compare the sound of two files; without any there are no figures.

    observer: where it is the judge, its environment has DNSMOS.
    """
    if not (has_sound(source) and has_sound(decoded)):
        return VoiceQuality()
    first, second = (_read(name, RATE_HZ) for name in (source, decoded))
    try:
        intelligibility = estoi(*aligned(first, second, RATE_HZ))
    except ValueError:  # There is hardly any speech.
        return VoiceQuality()
    late_ms = round(1000 * delay_s(first, second, RATE_HZ))
    opinions: list[float | None] = [None, None]
    if isinstance(observer, MediaPipeJudge):
        opinions = [_dnsmos(observer.python, name) for name in (decoded, source)]
    return VoiceQuality(rounded(intelligibility, 3), float(late_ms), *opinions)


def _read(name: str, rate_hz: int) -> Array:
    return np.concatenate(list(read_sound(name, rate_hz))).astype(np.float64)


def _dnsmos(python: Path, name: str) -> float:
    """Raises `UserError` if the judge fails."""
    samples = (_read(name, DNSMOS_RATE_HZ) / FULL_SCALE).astype(np.float32)
    program = str(Path(__file__).with_name("dnsmos_program.py"))
    command = [str(python), program]
    said = run_program(command, [samples.tobytes()], "the judge failed")
    return round(float(json.loads(said)["ovrl_mos"]), 2)
