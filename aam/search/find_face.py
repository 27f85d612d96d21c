"""Search from coarse to fine in a picture, from a rough pose or from the eyes."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from aam.face_window import face_window
from aam.model import AppearanceModel, MultiResolutionModel, texture_at
from aam.sampling import normalised_luma, window_px
from aam.search.search import SearchOptions, SearchResult, search
from aam.warps import Warp, pose_from_eyes
from aam.window import FaceWindow, shrunk

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

# Bound of the parameters that a level takes over from the one before it, standard deviations.
HANDED_LIMIT = 2.0


@dataclass(frozen=True, slots=True)
class FaceFit:
    """A face in a picture.

    pose: (p,) in pixels of the picture.  shape: (n,).  landmarks: (m, 2) pixels.
    error: mean square residual of the finest level.  results: of each level, in its own pixels.
    """

    pose: Array
    shape: Array
    landmarks: Array
    error: float
    results: tuple[SearchResult, ...]


def find_face(
    model: MultiResolutionModel,
    picture: Picture,
    pose: Array,
    options: SearchOptions | None = None,
) -> FaceFit:
    """The head of a model fitted to a face near a rough pose, from the mean shape.

    picture: (h, w, 3) or (h, w) uint8 BGR.  pose: (6,) of weak perspective, pixels of the picture.
    """
    window = face_window(picture, pose, window_px(model.sizes[-1]))
    warps = [model.warp(number) for number in range(len(model.levels))]
    found = find_in_window(
        model.levels,
        warps,
        model.normalisation,
        window,
        window.pose_to_window(pose),
        options or SearchOptions(),
    )
    at = window.pose_to_source(found.pose)
    return FaceFit(
        at, found.shape, warps[-1].landmarks(found.shape, at), found.error, found.results
    )


def find_in_window(
    levels: Sequence[AppearanceModel],
    warps: Sequence[Warp],
    normalisation: str,
    window: FaceWindow,
    pose: Array,
    options: SearchOptions,
) -> FaceFit:
    """The same within a window; poses and landmarks in its pixels."""
    whole = FaceWindow(window.picture, np.zeros(2), 1.0)
    c, results = np.zeros(len(levels[0].deviations)), list[SearchResult]()
    shape = levels[0].shape_of(c)
    for number, (level, warp) in enumerate(zip(levels, warps, strict=True)):
        view = shrunk(whole, window_px(warp.size))
        luma, at = normalised_luma(view, normalisation), view.pose_to_window(pose)
        if number:
            bound = HANDED_LIMIT * level.deviations
            texture = texture_at(warp, luma, shape, at)
            c = np.clip(level.parameters_of(shape, texture), -bound, bound)
        result = search(level, warp, luma, at, c, options)
        results.append(result)
        pose, shape = view.pose_to_source(result.pose), level.shape_of(result.c)
    landmarks = warps[-1].landmarks(shape, pose)
    return FaceFit(pose, shape, landmarks, results[-1].error, tuple(results))


def pose_at_eyes(model: MultiResolutionModel, eyes_px: Array) -> Array:
    """(6,) the frontal pose of the mean face whose eyes are at given places.

    eyes_px: (2, 2) middle between the corners of the right and of the left eye, pixels.
    """
    return pose_from_eyes(model.warp(0), model.levels[0].shape.mean, eyes_px)
