"""Expression Action Units and emotions, as muscle contractions (thesis 2.3.1, Table 2.3)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.anatomy import muscle_table as m
from shared_model.anatomy.jaw_and_eyelids import eyelid_field, gaze_field, jaw_field
from shared_model.anatomy.mouth import MouthLine, lower_lip, mouth_line, upper_lip
from shared_model.anatomy.muscles import Muscle, Points, falloff
from shared_model.arrays import Array
from shared_model.mesh import PARTS
from shared_model.parameters import EAU_INDEX, EAUS


@dataclass(frozen=True, slots=True)
class Anatomy:
    """A head with what the muscles are anchored to.

    vertices: (n, 3) mm.  parts: (n,) index into `mesh.PARTS`.  points: landmark -> (3,) mm.
    """

    vertices: Array
    parts: NDArray[np.integer]
    points: Points
    line: MouthLine

    def pull(self, *pulls: tuple[Muscle, float]) -> Array:
        """(n, 3) mm of pairs of muscles at the given contractions, on skin and mouth only."""
        field = np.zeros_like(self.vertices)
        for muscle, contraction in pulls:
            field += contraction * self._both_sides(muscle)
        return field

    def _both_sides(self, muscle: Muscle) -> Array:
        """(n, 3) mm of a muscle on both sides, see `overlapped`."""
        left = muscle.displacement(self.vertices, self.points, "l")
        if muscle not in m.UNPAIRED:
            right = muscle.displacement(self.vertices, self.points, "r")
            left = overlapped(left, right)
        return np.asarray(left * self.reach(muscle)[:, None])

    def reach(self, muscle: Muscle) -> Array:
        """(n,) 0..1 what a muscle moves: skin and mouth; a muscle of one lip that lip alone."""
        soft = np.isin(self.parts, [PARTS.index("skin"), PARTS.index("mouth")])
        if muscle is m.LEVATOR_LABII:
            return np.asarray(soft * (1 - self.line.lower * (1 - self.line.along)))
        if muscle is m.DEPRESSOR_LABII:
            return np.asarray(soft * self.line.lower)
        return soft.astype(np.float64)


def overlapped(left: Array, right: Array) -> Array:
    """(n, 3) mm of two sides of a muscle, where they overlap at most the maximum of either."""
    total = left + right
    strongest = max(float(np.linalg.norm(side, axis=1).max()) for side in (left, right))
    length = np.linalg.norm(total, axis=1)
    return np.asarray(total * np.minimum(1, strongest / np.maximum(length, 1e-9))[:, None])


def anatomy_of(
    vertices: Array,
    triangles: NDArray[np.integer],
    parts: NDArray[np.integer],
    landmarks: Mapping[str, int],
) -> Anatomy:
    """The anatomy of a head, see `eau_fields`."""
    points = {name: vertices[index] for name, index in landmarks.items()}
    return Anatomy(vertices, parts, points, mouth_line(vertices, triangles, points))


@dataclass(frozen=True, slots=True)
class Actuator:
    """One end of an EAU's range: its displacement field and a description of its cause."""

    field: Callable[[Anatomy], Array]
    works_by: str


def _pulls(*pairs: tuple[Muscle, float]) -> Actuator:
    shares = [m.name if share == 1 else f"{share:g} {m.name}" for m, share in pairs]
    return Actuator(lambda head: head.pull(*pairs), ", ".join(shares))


def eau_fields(
    vertices: Array,
    triangles: NDArray[np.integer],
    parts: NDArray[np.integer],
    landmarks: Mapping[str, int],
) -> tuple[Array, Array]:
    """Displacement fields of the EAUs at +1 and at -1: two of (len(EAUS), n, 3) float64, mm.

    vertices: (n, 3) mm, head frame, neutral.  triangles: (m, 3).  parts: (n,) index into `PARTS`.
    landmarks: name -> vertex.  Raises ValueError if a muscle's landmark is missing.
    """
    head = anatomy_of(vertices, triangles, parts, landmarks)
    up, down = (np.zeros((len(EAUS), *vertices.shape)) for _ in range(2))
    for table, fields in ((UP, up), (DOWN, down)):
        for name, actuator in table.items():
            fields[EAU_INDEX[name]] = actuator.field(head)
    return up, down


def _lids(head: Anatomy, side: str, upper: float, lower: float) -> Array:
    return eyelid_field(head.vertices, head.parts, head.points, side, upper, lower)


def _gaze(head: Anatomy, horizontal: float, vertical: float) -> Array:
    """(n, 3) mm: eyeballs turned; the eyelids follow the vertical part."""
    field = gaze_field(head.vertices, head.parts, horizontal, vertical)
    if vertical:
        upper, lower = (0.3, 0.1) if vertical < 0 else (0.22, 0.2)
        for side in "lr":
            field += _lids(head, side, -upper * vertical, lower * vertical)
    return field


def _lower_lip_lower(head: Anatomy) -> Array:
    return head.pull((m.DEPRESSOR_LABII, 1.0))


def _lip_press(head: Anatomy) -> Array:
    """(n, 3) mm: the vermilion of the lips rolled in, towards the line between them."""
    field = np.zeros_like(head.vertices)
    lips = upper_lip(head.line, 22) + lower_lip(head.line, 24)
    soft = np.isin(head.parts, [PARTS.index("skin"), PARTS.index("mouth")])
    front = falloff(head.points["sto"][2] - head.vertices[:, 2], 8, 24) * soft * lips
    field[:, 1] = -PRESS_SHARE * head.line.above * front
    field[:, 2] = -PRESS_BACK_MM * front * falloff(np.abs(head.line.above), 4, 16)
    return field


PRESS_SHARE = 0.22
PRESS_BACK_MM = 2.0

UP: Mapping[str, Actuator] = {
    "jaw_drop": Actuator(
        lambda h: jaw_field(h.vertices, h.parts, h.points, h.line), "rotation about the condyles"
    ),
    "mouth_corners": _pulls((m.ZYGOMATIC_MAJOR, 1.0)),
    "eyebrow_middle": _pulls((m.FRONTALIS_MAJOR, 1.0)),
    "eyebrow_inner": _pulls((m.FRONTALIS_INNER, 1.0)),
    "eyebrow_outer": _pulls((m.FRONTALIS_OUTER, 1.0)),
    "nose_base": _pulls((m.NASI_LABII, 1.0), (m.PROCERUS, 0.5), (m.DEPRESSOR_SUPERCILII, 0.6)),
    "lid_left": Actuator(lambda h: _lids(h, "l", 0.95, 0.12), "lids over the eyeball"),
    "lid_right": Actuator(lambda h: _lids(h, "r", 0.95, 0.12), "lids over the eyeball"),
    "gaze_horizontal": Actuator(lambda h: _gaze(h, 1, 0), "eyeballs"),
    "gaze_vertical": Actuator(lambda h: _gaze(h, 0, 1), "eyeballs, lids following"),
    "lip_stretch": _pulls((m.RISORIUS, 1.0)),
    "upper_lip_raise": Actuator(
        lambda h: h.pull((m.LEVATOR_LABII, 1.0)), "levator labii on the upper lip"
    ),
    "lower_lip_lower": Actuator(_lower_lip_lower, "depressor labii on the lower lip"),
    "lip_press": Actuator(_lip_press, "orbicularis oris, marginal part"),
}
DOWN: Mapping[str, Actuator] = {
    "mouth_corners": _pulls((m.ANGULI_DEPRESSOR, 1.0)),
    "eyebrow_middle": _pulls((m.LATERAL_CORRUGATOR, 0.25), (m.DEPRESSOR_SUPERCILII, 0.9)),
    "eyebrow_inner": _pulls(
        (m.LATERAL_CORRUGATOR, 0.3), (m.PROCERUS, 0.6), (m.DEPRESSOR_SUPERCILII, 0.45)
    ),
    "eyebrow_outer": _pulls((m.ORBICULARIS_OCULI, 1.0)),
    "lid_left": Actuator(lambda h: _lids(h, "l", -0.55, -0.04), "upper lid raised"),
    "lid_right": Actuator(lambda h: _lids(h, "r", -0.55, -0.04), "upper lid raised"),
    "gaze_horizontal": Actuator(lambda h: _gaze(h, -1, 0), "eyeballs"),
    "gaze_vertical": Actuator(lambda h: _gaze(h, 0, -1), "eyeballs, lids following"),
    "lip_stretch": _pulls((m.ORBICULARIS_ORIS, 1.0)),
    "lower_lip_lower": Actuator(lambda h: -_lower_lip_lower(h), "mentalis, on the lower lip"),
}


@dataclass(frozen=True, slots=True)
class Emotion:
    """A prototypic expression (Table 2.3): the range of each actuator that signs it."""

    name: str
    ranges: Mapping[str, tuple[float, float]]

    def peak(self) -> Array:
        """(len(EAUS),) each actuator at the end of its range with the larger magnitude."""
        eau = np.zeros(len(EAUS))
        for name, (low, high) in self.ranges.items():
            eau[EAU_INDEX[name]] = high if high > -low else low
        return eau


EMOTIONS = (
    Emotion(
        "happiness", {"mouth_corners": (0, 0.9), "eyebrow_inner": (0, 0.2), "jaw_drop": (0, 0.5)}
    ),
    Emotion(
        "anger",
        {
            "nose_base": (0, 0.7),
            "eyebrow_inner": (-0.9, 0),
            "eyebrow_middle": (-0.9, 0),
            "eyebrow_outer": (-0.5, 0),
        },
    ),
    Emotion(
        "surprise",
        {
            "mouth_corners": (0, 0.4),
            "eyebrow_inner": (0, 0.5),
            "eyebrow_middle": (0, 0.6),
            "jaw_drop": (0, 0.9),
        },
    ),
    Emotion(
        "sadness",
        {"mouth_corners": (-0.9, 0), "eyebrow_inner": (0, 0.7), "eyebrow_middle": (0, 0.5)},
    ),
    Emotion(
        "fear",
        {
            "eyebrow_inner": (0, 0.2),
            "eyebrow_middle": (0, 0.5),
            "eyebrow_outer": (0, 0.2),
            "jaw_drop": (0, 0.4),
        },
    ),
    Emotion(
        "disgust",
        {
            "nose_base": (0, 0.9),
            "eyebrow_inner": (-0.1, 0),
            "eyebrow_outer": (0, 0.2),
            "jaw_drop": (0, 0.1),
        },
    ),
)


# The actuators that sign an emotion; eyelids and gaze, and the lips' own muscles, sign none.
SIGNING = tuple(
    EAU_INDEX[name] for name in dict.fromkeys(n for emotion in EMOTIONS for n in emotion.ranges)
)
# Actuators of a shorter vector (their Euclidean norm) are a face at rest: noise of a tracker.
REST_LENGTH = 0.25


def signature(eau: Array) -> dict[str, Array]:
    """Similarity of actuators (..., len(EAUS)) to each emotion (Table 2.3): name -> (...,).

    The cosine with its peak, of the actuators that sign an emotion: 1 is its direction at any
    strength.  0 where it is negative, and of a face at rest.
    """
    signing = eau[..., SIGNING]
    length = np.linalg.norm(signing, axis=-1)
    found = {}
    for emotion in EMOTIONS:
        peak = emotion.peak()[list(SIGNING)]
        cosine = signing @ peak / (np.maximum(length, REST_LENGTH) * np.linalg.norm(peak))
        found[emotion.name] = np.where(length < REST_LENGTH, 0.0, np.maximum(cosine, 0.0))
    return found
