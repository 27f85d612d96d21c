"""Prediction by regression on displacements that are drawn, instead of numeric derivatives.

Derivatives at the truth (thesis eq. 2.27) saturate: what they say of a displacement of 10 % is less
than half of it.  Ridge regression predicts the whole range alike (Cootes, Edwards and Taylor 1998),
and is chosen by what it predicts of people who are left out.  The residuals are smoothed, which is
a linear step and so a part of the matrix: Psi keeps its form, and a search its cost.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from aam.model import AppearanceModel, residual
from aam.training.faces import TrainingFace, second_half
from aam.training.ridge import Moments, ridge_by_halves
from aam.warps import Warp
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Indices, Single

# The farthest displacements that are drawn: shares of the face's width and height, logarithm of the
# scale, degrees.  Table 2.4 has +-15 degrees; Fig. 2.22 asks for more
# of pitch and yaw.
SHARE, LOG_SCALE = 0.1, float(np.log(1.1))
REACH_DEG = {"rx": 22.0, "ry": 17.0, "rz": 13.0, "turn": 13.0}
# Of combined parameters, standard deviations, all drawn at once.
C_REACH = 1.0
# Draws of each face: of each parameter of the pose, by itself; of c.
POSE_DRAWS, C_DRAWS = 2, 4
# What counts the displacement of another parameter of the pose, from which nothing must be
# predicted, in terms of the own one; of the pose, where c is predicted.
OTHER_WEIGHT, POSE_WEIGHT = 0.2, 0.05
# Standard deviation of the Gaussian and spacing of its samples, in terms of the atlas' side.
BLUR, SPACING = 1 / 64, 1 / 32
_CHUNK = 64


def regressed_matrix(
    model: AppearanceModel,
    warp: Warp,
    faces: Sequence[TrainingFace],
    truth: Array,
    random: np.random.Generator,
) -> Single:
    """(p + M, k) Psi: its product with a residual is the displacement of pose and c.

    truth: (faces, M) combined parameters.  Pose and c are predicted independently, as in the
    thesis, but c from what the pose does not explain.  The ridges are those that predict best of
    the half of the people that was left out.
    """
    poses, smooth = len(warp.pose_names), Smoothing(warp)

    def moments(draws: int, low: Array) -> tuple[Moments, Moments]:
        """Of residuals and displacements (p + M,) from `low` to its negative."""
        face = np.repeat(np.arange(len(faces)), draws)
        steps = random.uniform(-1, 1, (len(face), len(low))) * low
        rows = _smoothed_residuals(model, warp, faces, truth, smooth, face, steps)
        is_second = second_half(faces)[face]
        return tuple(Moments.of(rows[own], steps[own]) for own in (~is_second, is_second))  # type: ignore[return-value]

    reach = np.concatenate([pose_reach(warp), C_REACH * model.deviations])
    each = [moments(POSE_DRAWS, row) for row in np.diag(reach)[:poses]]
    combined = moments(C_DRAWS, np.where(np.arange(len(reach)) < poses, 0.0, reach))
    rows = []
    for index in range(poses):
        weights = [1.0 if number == index else OTHER_WEIGHT for number in range(poses)]
        rows.append(ridge_by_halves(each, weights, slice(index, index + 1)))
    weights = [*[POSE_WEIGHT] * poses, 1.0]
    rows.append(ridge_by_halves([*each, combined], weights, slice(poses, None)))
    return smooth.spread(np.hstack(rows).T)


def pose_reach(warp: Warp) -> Array:
    """(p,) the farthest displacement of each parameter of the pose that is drawn."""
    lengths = {"tx": SHARE * warp.width, "ty": SHARE * warp.height, "scale": LOG_SCALE}
    return np.array(
        [
            lengths[name] if name in lengths else np.radians(REACH_DEG[name])
            for name in warp.pose_names
        ]
    )


class Smoothing:
    """A Gaussian over the texels of a warp, sampled on a grid of them."""

    def __init__(self, warp: Warp) -> None:
        self._rows, self._columns, self._size = warp.rows, warp.columns, warp.size
        spacing = max(round(SPACING * warp.size), 1)
        chosen = (warp.rows % spacing == 0) & (warp.columns % spacing == 0)
        self._at = warp.rows[chosen], warp.columns[chosen]

    def sampled(self, texture: Single) -> Single:
        """(q,) samples of a smoothed texture (k,)."""
        picture = np.zeros((self._size, self._size), np.float32)
        picture[self._rows, self._columns] = texture
        return np.asarray(self._blurred(picture)[self._at])

    def spread(self, weights: Array) -> Single:
        """(m, k): weights of texels that do what weights (m, q) of samples do."""
        found = []
        for row in weights:
            picture = np.zeros((self._size, self._size), np.float32)
            picture[self._at] = row
            found.append(self._blurred(picture)[self._rows, self._columns])
        return np.array(found)

    def _blurred(self, picture: Single) -> Single:
        border = cv2.BORDER_CONSTANT
        return np.asarray(
            cv2.GaussianBlur(picture, (0, 0), BLUR * self._size, borderType=border), np.float32
        )


def _smoothed_residuals(
    model: AppearanceModel,
    warp: Warp,
    faces: Sequence[TrainingFace],
    truth: Array,
    smooth: Smoothing,
    face: Indices,
    steps: Array,
) -> Single:
    """(N, q) at steps (N, p + M) away from the truth of faces (N,)."""
    poses = len(warp.pose_names)

    def chunk(start: int) -> list[Single]:
        found = []
        for row in range(start, min(start + _CHUNK, len(face))):
            at, step = faces[face[row]], steps[row]
            pose, c = warp.displaced(at.pose, step[:poses]), truth[face[row]] + step[poses:]
            found.append(smooth.sampled(residual(model, warp, at.luma, pose, c)))
        return found

    chunks = parallel_map(chunk, range(0, len(face), _CHUNK), None)
    return np.array([row for rows in chunks for row in rows])
