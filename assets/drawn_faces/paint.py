"""The skin of a person who does not exist, painted on the generic head: brightness at any point.

What is painted is found by its place on the neutral generic head, so that features stay on the
vertices that identities and muscles move.
"""

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from encoder.detection.landmark_indices import EYE_CORNER_PAIRS, EYELID_MARGINS
from risorius.animation.synthetic_skin import BROWS, network_points
from shared_model.arrays import Array
from shared_model.mesh import OUTER_LIPS, Head
from shared_model.mesh import PARTS as HEAD_PARTS

# Paint thins out over so many mm at its edge.
SOFT_MM = 1.5
# Iris and pupil, mm from the eye's axis.
IRIS_MM, PUPIL_MM = 6.0, 2.4
# Waves of the noise on the skin, mm.
WAVES_MM = (45.0, 18.0, 7.0)
WAVES = 24
# Greatest standard deviations of these, logarithms of brightness.
WAVE_STRENGTHS = (0.12, 0.08, 0.04)


@dataclass(frozen=True, slots=True)
class Skin:
    """How a person's skin is painted; logarithms of brightness relative to the skin's.

    tone: brightness of the skin, 0..1.  hair, lips, whites, iris: of these; lower_lip: more than
        the upper one.
    brow: how dense; brow_up_mm, brow_mm: where, and half how thick.
    hairline_mm: higher than usual.  lash, crease, socket, nostril, fold, bag: how dark.
    beard: how dense; beard_mm: how far it reaches to the sides and up from the mouth, and down.
    fringe_mm: how far hair hangs over the forehead.  shine: share of light that is mirrored.
    noise: (3, WAVES, 5) waves: direction and phase, strength.  gaze_mm: (2,) of the irises.
    """

    tone: float
    hair: float
    lips: float
    lower_lip: float
    whites: float
    iris: float
    brow: float
    brow_up_mm: float
    brow_mm: float
    hairline_mm: float
    lash: float
    crease: float
    socket: float
    nostril: float
    fold: float
    bag: float
    beard: float
    beard_mm: Array
    fringe_mm: float
    shine: float
    gaze_mm: Array
    noise: Array = field(repr=False)


def draw_skin(random: np.random.Generator) -> Skin:
    """The skin of a new person."""
    uniform, tone = random.uniform, float(random.uniform(0.18, 0.85))
    waves = random.normal(0, 1, (len(WAVES_MM), WAVES, 5))
    waves[..., 4] *= uniform(0.0, WAVE_STRENGTHS)[:, None]
    return Skin(
        tone,
        hair=np.log(min(uniform(0.03, 0.4), 0.8 * tone) / tone),
        lips=-uniform(0.1, 0.7),
        lower_lip=uniform(0.0, 0.25),
        whites=np.log(uniform(0.45, 0.8) / tone) * 0.8,
        iris=np.log(uniform(0.05, 0.3) / tone),
        brow=uniform(0.3, 1.0),
        brow_up_mm=random.normal(0, 1.2),
        brow_mm=uniform(2.0, 4.2),
        hairline_mm=random.normal(2, 8),
        lash=-uniform(0.3, 1.1),
        crease=-uniform(0.0, 0.5),
        socket=-uniform(0.0, 0.45),
        nostril=-uniform(0.4, 1.4),
        fold=-uniform(0.0, 0.35),
        bag=random.uniform(-0.3, 0.1),
        beard=max(uniform(-2.0, 0.9), 0.0),
        beard_mm=uniform([10, -4, 25], [60, 22, 60]),
        fringe_mm=max(uniform(-150, 35), 0.0),
        shine=uniform(0.0, 0.35),
        gaze_mm=random.normal(0, [1.5, 0.7]),
        noise=waves,
    )


class Painter:
    """Paints skins on a head at points of its neutral surface."""

    def __init__(self, head: Head) -> None:
        at = network_points
        self._lips = at(head, OUTER_LIPS)
        self._brows = [at(head, line) for line in BROWS]
        corners = [at(head, pair) for pair in EYE_CORNER_PAIRS]
        self._upper, self._lower, self._eyes = list[Array](), list[Array](), list[Array]()
        for margin, (outer, inner) in zip(EYELID_MARGINS, corners, strict=True):
            lower, upper = at(head, margin[:7]), at(head, margin[7:])
            self._upper.append(np.vstack([outer, upper, inner]))
            self._lower.append(np.vstack([outer, lower, inner]))
            self._eyes.append((outer + inner) / 2)
        mark = {name: head.vertices[index] for name, index in head.landmarks.items()}
        self._axes = [_eye_axis(head, part) for part in ("eye_right", "eye_left")]
        self._mark = mark
        self._parts = {name: index for index, name in enumerate(HEAD_PARTS)}

    def brightness(self, skin: Skin, place: Array, part: Array) -> Array:
        """(k,) in 0..1, unlit, of points (k, 3), mm, of the neutral head, on parts (k,)."""
        gain = self._skin_gain(skin, place)
        for name, axis in zip(("eye_right", "eye_left"), self._axes, strict=True):
            away = np.linalg.norm(place[:, :2] - axis - skin.gaze_mm, axis=1)
            eye = skin.whites + (skin.iris - skin.whites) * _soft(IRIS_MM - away, 0.8)
            eye = eye + (np.log(0.03 / skin.tone) - eye) * _soft(PUPIL_MM - away, 0.8)
            gain = np.where(part == self._parts[name], eye, gain)
        inside = np.log(np.array([0.75, 0.75, 0.3, 0.06]) / skin.tone)
        for name, value in zip(
            ("teeth_upper", "teeth_lower", "tongue", "mouth"), inside, strict=True
        ):
            gain = np.where(part == self._parts[name], value, gain)
        return np.asarray(np.clip(skin.tone * np.exp(gain), 0, 1))

    def _skin_gain(self, skin: Skin, place: Array) -> Array:
        front = place[:, 2] > 40
        gain = _noise(skin.noise, place)
        gain = gain + (skin.hair - gain) * skin.beard * self._beard(skin, place)
        lips, sto = _within(place, self._lips), self._mark["sto"]
        colour = skin.lips + skin.lower_lip * (place[:, 1] < sto[1])
        gain = np.where(front, gain + (colour - gain) * _soft(lips, SOFT_MM), gain)
        gain -= 0.5 * np.exp(-(((place[:, 1] - sto[1]) / 0.9) ** 2)) * _soft(lips, SOFT_MM)
        for outer, upper, lower in zip(self._eyes, self._upper, self._lower, strict=True):
            gain += skin.lash * _soft(1.0 - _distance(place, upper), 1.2)
            gain += 0.5 * skin.lash * _soft(0.5 - _distance(place, lower), 1.2)
            gain += skin.crease * _soft(1.0 - _distance(place, upper + np.array([0, 4.0, 0])), 2.0)
            gain += skin.bag * _soft(2.0 - _distance(place, lower - [0, 7.0, 0]), 6.0)
            gain += skin.socket * _bump(place, outer + np.array([0, 4, 0]), (22, 11))
        for side in (-1, 1):
            nostril = self._mark["sn"] + [side * 7.5, 3.5, 2.0]
            gain += skin.nostril * _bump(place, nostril, (4.5, 2.6))
            wing, corner = (
                self._mark[f"{name}_{'r' if side < 0 else 'l'}"] for name in ("al", "ch")
            )
            line = np.array(
                [wing + np.array([side * 2, 2, 0]), corner + np.array([side * 6, 4, 0])]
            )
            gain += skin.fold * _soft(1.5 - _distance(place, line), 5.0)
        for line in self._brows:
            away = _distance(place, line + np.array([0, skin.brow_up_mm - skin.brow_mm / 2, 0]))
            gain += (skin.hair - gain) * skin.brow * _soft(skin.brow_mm - away, 2.5)
        top = self._mark["tr"][1] + 4 + skin.hairline_mm
        top = top - skin.fringe_mm * np.exp(-((place[:, 0] / 45) ** 4))
        hair = np.maximum(
            place[:, 1] - (top - 0.006 * place[:, 0] ** 2),
            np.minimum(4 - place[:, 2], place[:, 1] + 8),
        )
        return np.asarray(gain + (skin.hair - gain) * _soft(hair, 6.0))

    def _beard(self, skin: Skin, place: Array) -> Array:
        """(k,) how much of a beard is at points; none beside the mouth's height but a moustache."""
        side, up, down = skin.beard_mm
        sn, sto, chin = (self._mark[name] for name in ("sn", "sto", "gn"))
        top = np.minimum(sto[1] + up, sn[1] - 2)
        within = np.minimum(side - np.abs(place[:, 0]), top - place[:, 1])
        within = np.minimum(within, np.minimum(place[:, 1] - chin[1] + down, place[:, 2] - 20))
        grain = np.sin(place @ [1.7, 2.3, 0.9]) * np.sin(place @ [-2.1, 1.1, 1.3])
        return np.asarray(_soft(within, 8.0) * (0.85 + 0.15 * grain))


def _soft(within_mm: Array, width_mm: float) -> Array:
    return np.clip(0.5 + within_mm / width_mm, 0, 1)


def _bump(place: Array, centre: Array, radii_mm: tuple[float, float]) -> Array:
    away = ((place[:, :2] - centre[:2]) / radii_mm) ** 2
    return np.asarray(np.exp(-away.sum(1)) * (place[:, 2] > 40))


def _distance(place: Array, line: Array) -> Array:
    """(k,) mm from points (k, 3) to a line of points (m, 3)."""
    nearest = np.full(len(place), np.inf)
    for a, b in pairwise(line):
        along = np.clip((place - a) @ (b - a) / max(float((b - a) @ (b - a)), 1e-9), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(place - a - along[:, None] * (b - a), axis=1))
    return nearest


def _within(place: Array, outline: Array) -> Array:
    """(k,) mm inside a closed outline (m, 3), seen from the front; outside negative."""
    x, y = place[:, 0], place[:, 1]
    inside, closed = np.zeros(len(x), bool), np.vstack([outline, outline[:1]])
    for (ax, ay, _), (bx, by, _) in pairwise(closed):
        with np.errstate(divide="ignore", invalid="ignore"):
            inside ^= ((ay > y) != (by > y)) & (x < ax + (y - ay) * (bx - ax) / (by - ay))
    flat = [1.0, 1.0, 0.0]
    away = _distance(place * flat, closed * flat)
    return np.where(inside, away, -away)


def _noise(waves: Array, place: Array) -> Array:
    """(k,) a sum of waves of each length, about as strong as they say."""
    total = np.zeros(len(place))
    for length, each in zip(WAVES_MM, waves, strict=True):
        direction = each[:, :3] * (2 * np.pi / length / np.sqrt(3))
        phase = place @ direction.T + 2 * np.pi * each[:, 3]
        total += np.sin(phase) @ each[:, 4] * np.sqrt(2 / WAVES)
    return total


def _eye_axis(head: Head, part: str) -> Array:
    """(2,) where the axis of an eyeball is, seen from the front, mm."""
    ball = head.vertices[head.parts == HEAD_PARTS.index(part)]
    return np.asarray((ball[:, :2].min(0) + ball[:, :2].max(0)) / 2)
