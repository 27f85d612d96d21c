"""The skin of a person who does not exist: spots, stubble, folds that deepen, light."""

from dataclasses import dataclass

import cv2
import numpy as np

from shared_model.arrays import Array, Picture, Single
from shared_model.parameters import EAU_INDEX

# How far these swing: light from the side and from above, highlights, tongue, teeth, features that
# are not where the mesh has them.
SWINGS = (0.05, 0.05, 0.08, 0.5, 0.15, 0.8, 0.8, 0.8)


@dataclass(frozen=True, slots=True)
class Fold:
    """Folds of the skin that deepen with an actuator.

    eau, sign: which actuator, to which side.  centre, axes: where, shares of the texture's size.
    lines: how many.  direction_deg: of the lines, from the rows of the texture.
    """

    eau: str
    sign: int
    centre: tuple[float, float]
    axes: tuple[float, float]
    lines: int
    direction_deg: float


FOLDS = (
    Fold("eyebrow_middle", 1, (0.5, 0.05), (0.25, 0.06), 5, 0),
    Fold("eyebrow_inner", -1, (0.5, 0.16), (0.05, 0.08), 3, 90),
    Fold("mouth_corners", 1, (0.31, 0.51), (0.04, 0.12), 1, 60),
    Fold("mouth_corners", 1, (0.69, 0.51), (0.04, 0.12), 1, -60),
    Fold("mouth_corners", 1, (0.18, 0.27), (0.06, 0.08), 4, 20),
    Fold("mouth_corners", 1, (0.82, 0.27), (0.06, 0.08), 4, -20),
    Fold("nose_base", 1, (0.5, 0.28), (0.05, 0.05), 3, 0),
    Fold("lower_lip_lower", -1, (0.5, 0.76), (0.08, 0.05), 2, 10),
    Fold("jaw_drop", 1, (0.5, 0.66), (0.3, 0.12), 1, 0),
)


@dataclass(frozen=True, slots=True)
class Skin:
    """What is drawn on a head.

    still: (n, n, 3) grey levels.  folds: (k, n, n), log gain at the full actuator, of `FOLDS`.
    slopes: (k, n, n), log gain per unit of what changes with time, see `SWINGS`.
    """

    still: Single
    folds: Single
    slopes: Single

    def at(self, eau: Array, swing: Array) -> Picture:
        """The texture at an expression (len(EAUS),) and a moment of what changes (k,)."""
        shares = [max(fold.sign * eau[EAU_INDEX[fold.eau]], 0.0) for fold in FOLDS]
        gain = np.tensordot(np.array(shares, np.float32), self.folds, 1)
        gain += np.tensordot(swing.astype(np.float32), self.slopes, 1)
        return np.asarray(np.clip(self.still * np.exp(gain)[..., None], 0, 255), np.uint8)


def smooth_noise(random: np.random.Generator, size: int, cells: float) -> Single:
    """(size, size) of unit variance, with about `cells` bumps on a side."""
    noise = random.standard_normal((size, size), dtype=np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), size / (4 * cells), borderType=cv2.BORDER_REFLECT)
    return np.asarray(blurred / blurred.std(), np.float32)


def make_skin(random: np.random.Generator, atlas: Picture) -> Skin:
    """The skin of a new person, from the texture of another."""
    size = len(atlas)
    still = recoloured(random, displaced(random, atlas).astype(np.float32))
    gain = stubble(random, size) + spots(random, size)
    for cells in (4, 12, 30, 70):
        gain += np.float32(random.uniform(0, 0.05)) * smooth_noise(random, size, cells)
    still *= np.exp(gain)[..., None]
    folds = np.array([creases(random, size, fold) for fold in FOLDS])
    return Skin(still, folds * np.float32(random.uniform(0.3, 1.2)), slopes(random, still))


def displaced(random: np.random.Generator, atlas: Picture) -> Picture:
    """The texture, mirrored or not, its features moved by up to a few hundredths of its size."""
    size = len(atlas)
    if random.random() < 0.5:
        atlas = np.ascontiguousarray(atlas[:, ::-1])
    rows, columns = np.mgrid[:size, :size].astype(np.float32)
    way = [0.012 * size * smooth_noise(random, size, 3) for _ in range(2)]
    # Teeth stay where they are.
    rest = np.clip((0.85 - rows / size) / 0.05, 0, 1)
    across, down = columns + rest * way[0], rows + rest * way[1]
    moved = cv2.remap(atlas, across, down, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
    return np.asarray(moved, np.uint8)


def recoloured(random: np.random.Generator, still: Single) -> Single:
    """Another complexion and another contrast."""
    mean = still.mean((0, 1))
    contrast = random.uniform(0.7, 1.3)
    tone = random.uniform(0.35, 1.15) * random.uniform(0.88, 1.12, 3)
    return np.asarray(np.clip((mean + contrast * (still - mean)) * tone, 2, 255), np.float32)


def stubble(random: np.random.Generator, size: int) -> Single:
    """Log gain (size, size) of a beard around mouth and chin, for some."""
    y, x = np.mgrid[:size, :size] / np.float32(size)
    around = np.exp(-(((x - 0.5) / 0.28) ** 4) - ((y - 0.68) / 0.2) ** 4)
    depth = max(random.uniform(-0.3, 0.4), 0.0)
    grain = 1 + 0.15 * smooth_noise(random, size, 60)
    return np.asarray(-depth * around * grain, np.float32)


def spots(random: np.random.Generator, size: int) -> Single:
    """Log gain (size, size) of moles and freckles."""
    marks = np.zeros((size, size), np.float32)
    for _ in range(random.integers(0, 40)):
        radius = random.uniform(0.5, 2.5)
        row, column = random.integers(0, size, 2)
        cv2.circle(marks, (int(column), int(row)), round(radius), -random.uniform(0.05, 0.5), -1)
    return np.asarray(cv2.GaussianBlur(marks, (0, 0), 0.8), np.float32)


def creases(random: np.random.Generator, size: int, fold: Fold) -> Single:
    """Log gain (size, size) of a person's folds at the full actuator."""
    y, x = np.mgrid[:size, :size] / np.float32(size)
    x, y = (v - c - random.normal(0, 0.01) for v, c in zip((x, y), fold.centre, strict=True))
    angle = np.radians(fold.direction_deg + random.normal(0, 12))
    across = np.cos(angle) * y - np.sin(angle) * x + 0.006 * smooth_noise(random, size, 5)
    width = abs(np.cos(angle)) * fold.axes[1] + abs(np.sin(angle)) * fold.axes[0]
    ridges = np.cos(np.pi * across / width * fold.lines + random.normal(0, 0.5))
    inside = np.exp(-((x / fold.axes[0]) ** 2) - (y / fold.axes[1]) ** 2)
    depth = random.uniform(0.02, 0.3) * (1 + 0.4 * smooth_noise(random, size, 4))
    return np.asarray(depth * inside * ridges, np.float32)


def slopes(random: np.random.Generator, still: Single) -> Single:
    """Log gains (k, n, n) of what changes with time, in the order of `SWINGS`."""
    size = len(still)
    y, x = np.mgrid[:size, :size] / np.float32(size)
    nose = (x - 0.5) / 0.04
    side = np.sin(2.6 * (x - 0.5)) + 0.5 * nose * np.exp(-(nose**2) / 2)
    above = np.cos(3 * y) + 0.1 * smooth_noise(random, size, 6)
    shiny = bump(x, y, 0.5, 0.08, 0.1) + bump(x, y, 0.5, 0.36, 0.03)
    shiny += bump(x, y, 0.26, 0.4, 0.06) + bump(x, y, 0.74, 0.4, 0.06)
    tongue = bump(x, y, 0.5 + random.normal(0, 0.03), 0.96, 0.06)
    teeth = (y > 0.88) * smooth_noise(random, size, 8)
    slopes = [side, above, shiny, tongue, teeth, *misplaced(random, still)]
    return np.array(slopes, np.float32)


def bump(x: Single, y: Single, centre_x: float, centre_y: float, radius: float) -> Single:
    """(n, n) 1 at a place, falling off around it."""
    away = ((x - centre_x) / radius) ** 2 + ((y - centre_y) / radius) ** 2
    return np.asarray(np.exp(-away), np.float32)


def misplaced(random: np.random.Generator, still: Single) -> list[Single]:
    """Log gains (n, n) of features that are a texel away from where the mesh has them."""
    size = len(still)
    luma = cv2.GaussianBlur(np.log(still.mean(2) + 8), (0, 0), 1)
    down, across = np.gradient(luma)
    fields = [smooth_noise(random, size, cells) for cells in (2, 2, 4, 4, 7, 7)]
    pairs = zip(fields[::2], fields[1::2], strict=True)
    return [np.asarray(first * down + second * across, np.float32) for first, second in pairs]
