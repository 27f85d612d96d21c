"""Search from coarse to fine in a picture, from the places of the eyes or from rough poses."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aam.model import AppearanceModel, MultiResolutionModel, texture_at
from aam.sampling import normalised_luma, window_px
from aam.search.search import SearchOptions, SearchResult, search
from aam.warps import Warp, pose_from_eyes
from aam.window import FaceWindow, face_window, shrunk
from shared_model.arrays import Array, Picture

# Bound of the parameters that a level takes over from the one before it, standard deviations.
HANDED_LIMIT = 2.0
# Share explained of a face, in terms of the mean over the training set.
LEAST_EXPLAINED = 0.5
# Starts about the eyes that a detector found: shift downwards in terms of their distance, scale.
STARTS = ((0.0, 1.0), (0.12, 1.0), (-0.12, 1.0), (0.0, 0.88), (0.0, 1.13))


@dataclass(frozen=True, slots=True)
class FaceFit:
    """A face in a picture.

    pose: (p,) in pixels of the picture.  shape: (n,).  landmarks: (m, 2) pixels.
    error: mean square residual of the finest level; 1 less it is the share of the texture's
        variance that the model explains.
    results: of each level, in its own pixels.
    """

    pose: Array
    shape: Array
    landmarks: Array
    error: float
    results: tuple[SearchResult, ...]


def is_explained(model: MultiResolutionModel, fit: FaceFit) -> bool:
    """Whether the model explains so much of the texture that it is a face's."""
    return 1 - fit.error >= LEAST_EXPLAINED * model.levels[-1].contrast[0]


def find_from_eyes(
    model: MultiResolutionModel, picture: Picture, eyes_px: Array, poses: Sequence[Array] = ()
) -> FaceFit:
    """The head of a model fitted to a face from the places of its eyes, as a detector finds them.

    Searches start at the mean shape, at several poses about the eyes.
    picture: (h, w, 3) or (h, w) uint8 BGR.
    eyes_px: (2, 2) middle of the right and of the left eye, pixels.
    poses: further poses (6,) where searches start.
    """
    warp, mean = model.warp(0), model.levels[0].shape.mean
    window = face_window(picture, pose_from_eyes(warp, mean, eyes_px), window_px(model.sizes[-1]))
    starts = starts_at_eyes(warp, mean, window.to_window(eyes_px))
    starts += [window.pose_to_window(pose) for pose in poses]
    warps = [model.warp(number) for number in range(len(model.levels))]
    options = SearchOptions()
    found = find_in_window(model.levels, warps, model.normalisation, window, starts, options)
    pose = window.pose_to_source(found.pose)
    landmarks = warps[-1].landmarks(found.shape, pose)
    return FaceFit(pose, found.shape, landmarks, found.error, found.results)


def starts_at_eyes(warp: Warp, shape: Array, eyes_px: Array) -> list[Array]:
    """Poses (p,) of a shape (n,) at and about eyes (2, 2), see `STARTS`."""
    across = eyes_px[1] - eyes_px[0]
    down, middle = np.array([-across[1], across[0]]), eyes_px.mean(0)
    return [
        pose_from_eyes(warp, shape, middle + shift * down + scale * (eyes_px - middle))
        for shift, scale in STARTS
    ]


def find_near(
    model: MultiResolutionModel, picture: Picture, pose: Array, shape: Array, first_level: int = 0
) -> FaceFit:
    """The head of a model fitted to a face from a pose (6,) and a shape (25,) near it.

    picture: (h, w, 3) uint8 BGR.  first_level: levels before it are left out.
    """
    window = face_window(picture, pose, window_px(model.sizes[-1]))
    numbers = range(first_level, len(model.levels))
    levels, warps = [model.levels[n] for n in numbers], [model.warp(n) for n in numbers]
    start, options = window.pose_to_window(pose), SearchOptions(forced=0)
    found = find_in_window(levels, warps, model.normalisation, window, [start], options, shape)
    at = window.pose_to_source(found.pose)
    landmarks = warps[-1].landmarks(found.shape, at)
    return FaceFit(at, found.shape, landmarks, found.error, found.results)


def find_in_window(
    levels: Sequence[AppearanceModel],
    warps: Sequence[Warp],
    normalisation: str,
    window: FaceWindow,
    poses: Sequence[Array],
    options: SearchOptions,
    start_shape: Array | None = None,
) -> FaceFit:
    """The same within a window, from given poses; they and landmarks in its pixels.

    poses: each (p,), where searches start.  The one that leaves the least at the coarsest level
        goes on.
    start_shape: (n,) near which they start; None: at the mean shape.
    """
    whole = FaceWindow(window.picture, np.zeros(2), 1.0)
    results = list[SearchResult]()
    pose, shape = poses[0], levels[0].shape.mean if start_shape is None else start_shape
    for number, (level, warp) in enumerate(zip(levels, warps, strict=True)):
        view = shrunk(whole, window_px(warp.size))
        luma = normalised_luma(view, normalisation)
        if number == 0 and start_shape is None:
            c = np.zeros(len(level.deviations))
            starts = [(view.pose_to_window(each), c) for each in poses]
        else:
            at, bound = view.pose_to_window(pose), HANDED_LIMIT * level.deviations
            texture = texture_at(warp, luma, shape, at)
            starts = [(at, np.clip(level.parameters_of(shape, texture), -bound, bound))]
        found = [search(level, warp, luma, *start, options) for start in starts]
        results.append(min(found, key=lambda each: each.error))
        pose = view.pose_to_source(results[-1].pose)
        shape = level.shape_of(results[-1].c)
    landmarks = warps[-1].landmarks(shape, pose)
    return FaceFit(pose, shape, landmarks, results[-1].error, tuple(results))
