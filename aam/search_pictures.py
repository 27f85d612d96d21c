"""A search step by step, as pictures (thesis Fig. 3.1 to 3.3)."""

from collections.abc import Sequence

import cv2
import numpy as np

from aam.model import AppearanceModel, texture_at
from aam.sampling import normalised_luma, window_px
from aam.search.find_face import FaceFit
from aam.synthesis import drawn_texture, texels_picture
from aam.warps import Warp
from aam.window import FaceWindow, shrunk
from shared_model.arrays import Array, Picture

SIDE_PX = 128
# The iterations of each level that are shown, beside its last one.
SHOWN = (0, 1, 2, 4)
POINT_BGR, TEXT_BGR = (60, 60, 230), (40, 160, 40)


def search_sheet(
    levels: Sequence[AppearanceModel],
    warps: Sequence[Warp],
    normalisation: str,
    window: FaceWindow,
    fit: FaceFit,
) -> Picture:
    """(h, w, 3) BGR, a column for each of some steps: the window with the landmarks and the number
    of the iteration, the texture under them, what the model makes of it, their difference, and the
    model's face from the front.

    levels, warps: from coarse to fine.  fit: a search in this window, see `find_in_window`.
    """
    whole, columns = FaceWindow(window.picture, np.zeros(2), 1.0), list[Picture]()
    for result, level, warp in zip(fit.results, levels, warps, strict=True):
        view = shrunk(whole, window_px(warp.size))
        luma = normalised_luma(view, normalisation)
        last = len(result.path) - 1
        for number in [*(each for each in SHOWN if each < last), last]:
            pose, c = result.path[number]
            shape = level.shape_of(c)
            found, made = texture_at(warp, luma, shape, pose), level.texture_of(c)
            points = warp.landmarks(shape, view.pose_to_source(pose))
            label = f"{number} of {last}, {warp.size}"
            tiles = [_marked(window.picture, points, label)]
            tiles += [_tile(texels_picture(warp, each)) for each in (found, made, found - made)]
            tiles.append(_tile(drawn_texture(warp, shape, made, warp.size)))
            columns.append(np.vstack(tiles))
    return np.asarray(np.hstack(columns), np.uint8)


def _marked(picture: Picture, points: Array, label: str) -> Picture:
    """The window with landmarks (m, 2), its pixels, and a line of text."""
    tile, ratio = _tile(picture), SIDE_PX / len(picture)
    at = np.clip(np.rint((points[:, :2] + 0.5) * ratio - 0.5).astype(int), 0, SIDE_PX - 1)
    tile[at[:, 1], at[:, 0]] = POINT_BGR
    cv2.putText(tile, label, (3, 11), cv2.FONT_HERSHEY_SIMPLEX, 0.35, TEXT_BGR, 1, cv2.LINE_AA)
    return tile


def _tile(picture: Picture) -> Picture:
    tile = cv2.resize(picture, (SIDE_PX, SIDE_PX), interpolation=cv2.INTER_AREA)
    return np.asarray(tile if tile.ndim == 3 else cv2.cvtColor(tile, cv2.COLOR_GRAY2BGR), np.uint8)
