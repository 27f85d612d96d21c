"""A search that starts at the landmark network's fit, weighted against the network.

Both err, and not alike: the most probable landmarks lie between what the network has found and
where a search goes from there, by the inverse of their error variances.
"""

import numpy as np

from aam.model import MultiResolutionModel, texture_at
from aam.sampling import normalised_luma, window_px
from aam.search.search import SearchOptions, search
from aam.window import face_window
from shared_model.arrays import Array, Picture

# Weight of the search: of people left out of the model, .2 to .3 leaves the least mean distance
# from landmarks set by hand.
SEARCH_WEIGHT = 0.25


def weighted_landmarks(
    model: MultiResolutionModel, picture: Picture, points: Array, pose: Array, shape: Array
) -> Array:
    """(468, 3) landmarks between those of the network and those of a search at the finest level.

    A search that finds nothing better than its start leaves the network's landmarks; those that
    the model does not have, and depths, stay in any case.

    picture: (h, w, 3) uint8 BGR.  points: (468, 3) of the network, pixels.
    pose: (6,) of weak perspective, pixels of the picture, and shape: (25,) AE shape vector, of the
        3D model fitted to the points.
    """
    level, warp = model.levels[-1], model.warp(len(model.levels) - 1)
    window = face_window(picture, pose, window_px(warp.size))
    luma = normalised_luma(window, model.normalisation)
    options, at = SearchOptions(forced=0), window.pose_to_window(pose)
    bound = options.limit * level.deviations
    c = level.parameters_of(shape, texture_at(warp, luma, shape, at))
    start = np.clip(c, -bound, bound)
    end = search(level, warp, luma, at, start, options)
    before = warp.landmarks(level.shape_of(start), pose)
    after = warp.landmarks(level.shape_of(end.c), window.pose_to_source(end.pose))
    weighted = np.array(points)
    weighted[warp.landmark_index, :2] += SEARCH_WEIGHT * (after - before)
    return weighted
