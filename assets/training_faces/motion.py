"""Random motion of a face that speaks, blinks and turns."""

from fractions import Fraction

import numpy as np

from shared_model.arrays import Array
from shared_model.curves import smooth_curve
from shared_model.parameters import EAU_HIGH, EAU_INDEX, EAU_LOW

FPS, FRAMES = Fraction(25), 64
# EAU -> seconds from one key to the next, and the share of the range that keys reach.
MOTION = {
    "jaw_drop": (0.16, 0.45),
    "mouth_corners": (0.8, 0.8),
    "eyebrow_middle": (0.9, 0.7),
    "eyebrow_inner": (0.9, 0.7),
    "eyebrow_outer": (0.9, 0.7),
    "nose_base": (1.5, 0.4),
    "gaze_horizontal": (0.7, 0.5),
    "gaze_vertical": (0.7, 0.4),
    "lip_stretch": (0.25, 0.6),
    "upper_lip_raise": (0.3, 0.5),
    "lower_lip_lower": (0.25, 0.5),
    "lip_press": (0.4, 0.4),
}
BLINK_EVERY_S, BLINK_S = 2.2, 0.3


def wander(random: np.random.Generator, key_s: float, low: float, high: float) -> Array:
    """(FRAMES,) smooth way through random keys, about `key_s` apart."""
    count = max(2, round(FRAMES / float(FPS) / key_s))
    times = np.sort(random.uniform(0, FRAMES, count)) + np.arange(count) * 1e-3
    return smooth_curve(np.arange(FRAMES), times, random.uniform(low, high, count))


def make_motion(random: np.random.Generator) -> tuple[Array, Array, Array]:
    """EAUs (FRAMES, len(EAUS)), turns (FRAMES, 3) in degrees and shifts (FRAMES, 3) in mm."""
    eau, lively = np.zeros((FRAMES, len(EAU_INDEX))), random.uniform(0.5, 1.1)
    for name, (key_s, share) in MOTION.items():
        low, high = EAU_LOW[EAU_INDEX[name]], EAU_HIGH[EAU_INDEX[name]]
        reach = lively * share * random.uniform(0.4, 1)
        eau[:, EAU_INDEX[name]] = wander(random, key_s, low * reach, high * reach)
    for middle in np.cumsum(random.exponential(BLINK_EVERY_S, 20)) * float(FPS):
        away = np.abs(np.arange(FRAMES) - middle) / (BLINK_S / 2 * float(FPS))
        for name in ("lid_left", "lid_right"):
            eau[:, EAU_INDEX[name]] = np.maximum(eau[:, EAU_INDEX[name]], np.clip(1 - away, 0, 1))
    turn = np.array([wander(random, 1.0, -a, a) for a in lively * np.array([7, 14, 5])]).T
    shift = np.array([wander(random, 1.2, -a, a) for a in lively * np.array([8, 6, 15])]).T
    return np.clip(eau, EAU_LOW, EAU_HIGH), turn, shift
