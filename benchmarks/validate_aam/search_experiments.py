"""Generalisation (3.1.2): searches in pictures of people who are not in the training set."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aam.sampling import window_px
from aam.search.search import SearchOptions
from aam.search_pictures import search_sheet
from aam.window import FaceWindow, shrunk
from benchmarks.validate_aam.contenders import (
    Contender,
    errors,
    find_from,
    found_points,
    start_pose,
)
from benchmarks.validate_aam.planar_warp import PLANAR_LANDMARKS
from benchmarks.validate_aam.samples import Sample
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Picture

# A displaced start is off by this much of the distance between the eyes; the size of the model at
# a start (3.1).
DISPLACEMENT = 0.25
SCALES = (0.9, 1.1)
RIGHT_NME = 0.05
# Pictures in which a search is shown step by step.
SHEETS = 3


@dataclass(frozen=True, slots=True, eq=False)
class Generalisation:
    """Of each picture: eq. 3.1, square pixels, and the mean distance of 68 landmarks in terms of
    the distance between the outer corners of the eyes.
    """

    squared: Array
    nme: Array

    @property
    def error(self) -> float:
        """G (eq. 3.2), square pixels."""
        return float(self.squared.mean())

    @property
    def right(self) -> float:
        """Share of the pictures whose mean distance is below 5 %."""
        return float((self.nme < RIGHT_NME).mean())

    def better_than(self, other: "Generalisation") -> float:
        """Share of the pictures in which the error is smaller than another's."""
        return float((self.squared < other.squared).mean())


def generalisation(
    contender: Contender,
    samples: Sequence[Sample],
    options: SearchOptions,
    displaced: bool,
    seed: int,
    anchors: str = "eyes",
) -> Generalisation:
    """Search each picture from its eyes, with the model 0.9 to 1.1 times as large.

    displaced: a quarter of the distance between the eyes off, in a random direction.
    anchors: where the search starts, see `start_pose`.
    """
    starts = _starts(contender, samples, displaced, seed, anchors)

    def one(number: int) -> tuple[float, float]:
        sample = samples[number]
        return errors(sample, found_points(contender, sample, starts[number], options))

    found = np.array(parallel_map(one, range(len(samples)), None))
    return Generalisation(found[:, 0], found[:, 1])


def convergence(
    contender: Contender,
    samples: Sequence[Sample],
    options: SearchOptions,
    displaced: bool,
    seed: int,
) -> list[Array]:
    """For each level (iterations + 1,) the mean distance of 68 landmarks in terms of the distance
    between the outer corners of the eyes, at its start and after each iteration (Fig. 3.1 to 3.3).

    A search that has ended stays where its last step has led.  Starts: see `generalisation`.
    """
    starts = _starts(contender, samples, displaced, seed)

    def one(number: int) -> list[list[float]]:
        sample = samples[number]
        window = FaceWindow(sample.face.window.picture, np.zeros(2), 1.0)
        fit = find_from(contender, sample, starts[number], options)
        found = []
        pairs = zip(fit.results, contender.levels, contender.warps, strict=True)
        for result, level, warp in pairs:
            view, path = shrunk(window, window_px(warp.size)), []
            for pose, c in result.path[: options.iterations + 1]:
                at = view.pose_to_source(pose)
                points = warp.landmarks(level.shape_of(c), at)
                path.append(errors(sample, contender.points(points, PLANAR_LANDMARKS))[1])
            found.append(path + [path[-1]] * (options.iterations + 1 - len(path)))
        return found

    paths = np.array(parallel_map(one, range(len(samples)), None))
    return list(paths.mean(0))


def step_sheet(
    contender: Contender,
    samples: Sequence[Sample],
    options: SearchOptions,
    displaced: bool,
    seed: int,
) -> Picture:
    """Searches step by step in a few pictures, evenly from all, one below the other, see
    `search_sheet`.  Starts: see `generalisation`.
    """
    starts = _starts(contender, samples, displaced, seed)
    sheets = []
    for number in np.linspace(0, len(samples) - 1, min(SHEETS + 2, len(samples)))[1:-1].astype(int):
        fit = find_from(contender, samples[number], starts[number], options)
        window, normalisation = samples[number].face.window, contender.options.normalisation
        sheets.append(search_sheet(contender.levels, contender.warps, normalisation, window, fit))
    width = max(sheet.shape[1] for sheet in sheets)
    padded = [np.pad(s, ((0, 0), (0, width - s.shape[1]), (0, 0))) for s in sheets]
    return np.asarray(np.vstack(padded), np.uint8)


def _starts(
    contender: Contender,
    samples: Sequence[Sample],
    displaced: bool,
    seed: int,
    anchors: str = "eyes",
) -> list[Array]:
    """The pose (p,) at which the search of each picture starts."""
    random = np.random.default_rng(seed)
    angles = random.uniform(0, 2 * np.pi, len(samples))
    scales = random.uniform(*SCALES, len(samples))
    ways = np.stack([np.cos(angles), np.sin(angles)], 1) * (DISPLACEMENT if displaced else 0.0)
    return [
        start_pose(contender, sample, way, float(scale), anchors)
        for sample, way, scale in zip(samples, ways, scales, strict=True)
    ]


def best_possible(contender: Contender, samples: Sequence[Sample]) -> Generalisation:
    """What the known pose and shape leave, reduced to the model's shape modes."""
    level, warp = contender.levels[-1], contender.warps[-1]
    faces = contender.prepared(samples, len(contender.levels) - 1)
    found = []
    for sample, face in zip(samples, faces, strict=True):
        ratio = len(sample.face.window.picture) / len(face.luma)
        shape = level.shape.values(level.shape.coefficients(face.shape))
        points = (warp.landmarks(shape, face.pose) + 0.5) * ratio - 0.5
        found.append(errors(sample, contender.points(points, PLANAR_LANDMARKS)))
    array = np.array(found)
    return Generalisation(array[:, 0], array[:, 1])
