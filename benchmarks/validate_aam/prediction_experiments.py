"""Quality of training (2.4.4): displaced pose and parameters, predicted from one residual."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aam.model import residual, texture_at
from benchmarks.validate_aam.contenders import Contender
from benchmarks.validate_aam.samples import Sample
from runtime.parallel import parallel_map
from shared_model.arrays import Array

# Displacements of Fig. 2.20: shares of the face's width and height, scales, degrees; of Fig. 2.22.
SHARES = (-0.1, -0.075, -0.05, -0.025, 0.025, 0.05, 0.075, 0.1)
SCALES = (0.9, 0.95, 1.05, 1.1)
ANGLES_DEG = (-10.0, -7.5, -5.0, -2.5, 2.5, 5.0, 7.5, 10.0)
WIDE_ANGLES_DEG = (-27.0, -20.0, -13.0, -7.0, -3.0, 3.0, 7.0, 13.0, 20.0, 27.0)
# Of combined parameters, standard deviations: the linear range of Table 2.6.
SIGMAS = (-0.8, -0.4, 0.4, 0.8)
C_COUNT = 8


@dataclass(frozen=True, slots=True)
class Matrix:
    """Which matrix predicts: at which level, by regression or by eq. 2.27."""

    level: int
    is_regressed: bool


@dataclass(frozen=True, slots=True, eq=False)
class PredictionCurve:
    """One parameter, displaced.

    unit: "% of the width", "% of the height", "%", "deg" or "sigma".
    actual: (d,) displacements.  predicted: (d, faces) what the matrix says, in the same unit.
    """

    name: str
    unit: str
    actual: Array
    predicted: Array

    @property
    def mean(self) -> Array:
        """(d,) mean prediction."""
        return np.asarray(self.predicted.mean(1))

    @property
    def error(self) -> float:
        """Mean absolute error."""
        return float(np.abs(self.predicted - self.actual[:, None]).mean())

    @property
    def linear_range(self) -> tuple[float, float]:
        """The widest interval about 0 in which at least half of every displacement is predicted,
        and at most one and a half times as much.
        """
        is_good = np.abs(self.mean / self.actual - 1) <= 0.5
        ends = []
        for sign in (-1, 1):
            side = sorted(np.flatnonzero(sign * self.actual > 0), key=lambda i: abs(self.actual[i]))
            reached = 0.0
            for index in side:
                if not is_good[index]:
                    break
                reached = float(self.actual[index])
            ends.append(reached)
        return ends[0], ends[1]


def pose_curves(
    contender: Contender, samples: Sequence[Sample], matrix: Matrix, wide: bool = False
) -> list[PredictionCurve]:
    """A curve for each parameter of the pose; `wide`: rotations of the head alone, Fig. 2.22."""
    level = matrix.level
    warp, curves = contender.warps[level], []
    for index, name in enumerate(warp.pose_names):
        if name in ("tx", "ty"):
            length, unit = (warp.width, "% of the width")
            if name == "ty":
                length, unit = (warp.height, "% of the height")
            steps, shown = np.array(SHARES) * length, 100 / length
        elif name == "scale":
            steps, shown, unit = np.log(SCALES), 100.0, "%"
        else:
            angles = WIDE_ANGLES_DEG if wide else ANGLES_DEG
            steps, shown, unit = np.radians(angles), 180 / np.pi, "deg"
        if not wide or unit == "deg":
            predicted = _predicted(contender, samples, matrix, index, steps)
            curves.append(PredictionCurve(name, unit, steps * shown, predicted * shown))
    return curves


def parameter_curves(
    contender: Contender, samples: Sequence[Sample], matrix: Matrix
) -> list[PredictionCurve]:
    """A curve for each of the first combined parameters (Table 2.6)."""
    level = matrix.level
    poses, curves = len(contender.warps[level].pose_names), []
    deviations = contender.levels[level].deviations
    for number, sigma in enumerate(deviations[:C_COUNT]):
        steps = np.array(SIGMAS) * sigma
        predicted = _predicted(contender, samples, matrix, poses + number, steps)
        curves.append(PredictionCurve(f"c{number}", "sigma", steps / sigma, predicted / sigma))
    return curves


def _predicted(
    contender: Contender, samples: Sequence[Sample], matrix: Matrix, index: int, steps: Array
) -> Array:
    """(d, faces) displacements of one parameter that the matrix sees."""
    model, warp = contender.levels[matrix.level], contender.warps[matrix.level]
    poses = len(warp.pose_names)
    row = (model.regressed if matrix.is_regressed else model.additive)[index]

    def one(number: int) -> list[float]:
        face = faces[number]
        c = model.parameters_of(face.shape, texture_at(warp, face.luma, face.shape, face.pose))
        found = []
        for value in steps:
            step = np.zeros(poses + len(c))
            step[index] = value
            pose = warp.displaced(face.pose, step[:poses])
            found.append(float(row @ residual(model, warp, face.luma, pose, c + step[poses:])))
        return found

    faces = contender.prepared(samples, matrix.level)
    return np.array(parallel_map(one, range(len(faces)), None)).T
