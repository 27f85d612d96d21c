"""The report of a training: pictures of mean and modes, tables of variance and residuals."""

from collections.abc import Sequence
from html import escape
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from aam.charts import NEEDED, Line, Panel, chart_svg, has_charts
from aam.model import AppearanceModel, MultiResolutionModel, texture_at
from aam.pca import LinearModel
from aam.search.find_face import find_in_window
from aam.search.search import SearchOptions
from aam.search_pictures import search_sheet
from aam.synthesis import drawn_texture, face_picture, texels_picture
from aam.training.faces import AnnotatedFace, at_resolution
from aam.training.train import TrainingOptions
from aam.warps import Warp
from runtime.parallel import parallel_map
from shared_model.arrays import Picture
from shared_model.errors import cannot_write

SIDE_PX = 128
SHOWN_MODES = 8
SIGMAS = (-2.0, 0.0, 2.0)
# By how much the shown search starts off the annotated pose: 4 degrees of yaw and roll, a tenth too
# large.
START = np.array([0.0, 0.07, 0.07, 0.0, 0.0, 0.1])
STYLE = (
    "body{font:15px sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "td,th{padding:.1em .8em;text-align:right}img{image-rendering:auto}"
    "meter{width:12em}"
)


def write_report(
    folder: Path,
    model: MultiResolutionModel,
    faces: Sequence[AnnotatedFace],
    options: TrainingOptions,
) -> Path:
    """Write index.html and its pictures; returns its path.  Raises `UserError`."""
    warp, finest = model.warp(len(model.levels) - 1), model.levels[-1]
    pictures = {
        "mean.png": mean_sheet(finest, warp),
        "combined.png": mode_sheet(finest, warp, "combined"),
        "shape.png": mode_sheet(finest, warp, "shape"),
        "texture.png": mode_sheet(finest, warp, "texture"),
        "weights.png": weight_sheet(finest, warp),
        "search.png": step_sheet(model, faces[len(faces) // 2]),
    }
    errors = person_residuals(model, faces)
    page = folder / "index.html"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, picture in pictures.items():
            encoded = cv2.imencode(".png", picture)[1]
            (folder / name).write_bytes(encoded.tobytes())
        if has_charts():
            (folder / "variance.svg").write_text(variance_chart(finest), encoding="utf-8")
        page.write_text(_html(model, len(faces), errors, options), encoding="utf-8")
    except OSError as error:
        raise cannot_write(page, error) from error
    return page


def mean_sheet(model: AppearanceModel, warp: Warp) -> Picture:
    """The mean face, the mean texture, the deviation of each texel (Fig. 2.16)."""
    c = np.zeros(len(model.deviations))
    modes, variances = model.texture.modes, model.texture.variances
    deviation = np.sqrt((modes.T**2) @ variances)
    frames = [
        texels_picture(warp, model.texture.mean),
        texels_picture(warp, 2 * deviation / deviation.max() - 1),
    ]
    shown = [face_picture(model, warp, c, warp.size), *frames]
    return np.asarray(np.hstack([_tile(each) for each in shown]), np.uint8)


def mode_sheet(model: AppearanceModel, warp: Warp, kind: str) -> Picture:
    """A column for each of the first modes: -2 standard deviations, the mean, +2 (Fig. 2.15).

    kind: "combined", "shape" or "texture".
    """
    linear = getattr(model, kind)
    columns = []
    for mode in range(min(len(linear.variances), SHOWN_MODES)):
        tiles = []
        for sigmas in SIGMAS:
            p = np.zeros(len(linear.variances))
            p[mode] = sigmas * np.sqrt(linear.variances[mode])
            shape, texture = model.shape.mean, model.texture.mean.astype(np.float32)
            if kind == "combined":
                shape, texture = model.shape_of(p), model.texture_of(p)
            elif kind == "shape":
                shape = linear.values(p)
            else:
                texture = linear.values(p).astype(np.float32)
            tiles.append(_tile(drawn_texture(warp, shape, texture, warp.size)))
        columns.append(np.vstack(tiles))
    return np.asarray(np.hstack(columns), np.uint8)


def weight_sheet(model: AppearanceModel, warp: Warp) -> Picture:
    """The rows of Psi for c and for the pose, dark where negative (Fig. 2.19)."""
    poses = len(warp.pose_names)

    def tile(row: NDArray[np.floating]) -> Picture:
        return _tile(texels_picture(warp, row / max(2 * float(row.std()), 1e-12)))

    upper = [tile(row) for row in model.additive[poses : 2 * poses]]
    lower = [tile(row) for row in model.additive[:poses]]
    blank = np.full((SIDE_PX, SIDE_PX), 255, np.uint8)
    upper += [blank] * (poses - len(upper))
    return np.asarray(np.vstack([np.hstack(upper), np.hstack(lower)]), np.uint8)


def variance_chart(model: AppearanceModel) -> str:
    """An SVG of the share of the variance that each mode has, and of all up to it (Fig. 2.14).

    Raises `UserError` if matplotlib is not installed.
    """
    panels = []
    for kind in ("shape", "texture", "combined"):
        linear: LinearModel = getattr(model, kind)
        shares = 100 * linear.variances / linear.total
        number = np.arange(1, len(shares) + 1)
        cumulated = Line("cumulated", number, np.cumsum(shares), ".-")
        panels.append(Panel(kind, "mode", "% of the variance", [cumulated], (number, shares)))
    return chart_svg(panels)


def step_sheet(model: MultiResolutionModel, face: AnnotatedFace) -> Picture:
    """A search step by step (Fig. 3.1), see `search_sheet`, from a start that is displaced."""
    warps = [model.warp(number) for number in range(len(model.levels))]
    start = face.pose + START
    options = SearchOptions("additive")
    fit = find_in_window(model.levels, warps, model.normalisation, face.window, [start], options)
    return search_sheet(model.levels, warps, model.normalisation, face.window, fit)


def person_residuals(
    model: MultiResolutionModel, faces: Sequence[AnnotatedFace]
) -> dict[str, tuple[int, float]]:
    """For each person the number of faces and the share of the textures' variance that the finest
    level does not explain.
    """
    warp, level = model.warp(len(model.levels) - 1), model.levels[-1]
    prepared = at_resolution(faces, warp.size, model.normalisation)

    def left(number: int) -> float:
        face = prepared[number]
        texture = texture_at(warp, face.luma, face.shape, face.pose)
        c = level.parameters_of(face.shape, texture)
        return float(((texture - level.texture_of(c)) ** 2).mean())

    shares = parallel_map(left, range(len(prepared)), None)
    found: dict[str, list[float]] = {}
    for face, share in zip(faces, shares, strict=True):
        found.setdefault(face.person, []).append(share)
    return {person: (len(each), float(np.mean(each))) for person, each in sorted(found.items())}


def _tile(picture: Picture) -> Picture:
    size = (SIDE_PX, SIDE_PX)
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _html(
    model: MultiResolutionModel,
    count: int,
    errors: dict[str, tuple[int, float]],
    options: TrainingOptions,
) -> str:
    people = sorted(errors.items(), key=lambda item: -item[1][1])
    rows = "".join(
        f"<tr><td>{escape(person)}<td>{number}<td>{share:.3f}"
        f'<td><meter value="{share:.3f}"></meter>'
        for person, (number, share) in people
    )
    levels = "".join(
        f"<tr><td>{size}<td>{len(level.texture.mean)}<td>{len(level.shape.variances)}"
        f"<td>{len(level.texture.variances)}<td>{len(level.combined.variances)}"
        f"<td>{100 * level.contrast[0]:.1f} %"
        for size, level in zip(model.sizes, model.levels, strict=True)
    )
    parts = [
        f"<!doctype html><meta charset=utf-8><title>Model</title><style>{STYLE}</style>",
        f"<h1>Model of {count} faces of {len(errors)} people</h1>",
        f"<p>{escape(str(options))}</p>",
        "<h2>Levels</h2><table><tr><th>texels a side<th>texels<th>shape modes<th>texture modes"
        f"<th>combined modes<th>explained variance{levels}</table>",
        "<h2>Mean face, mean texture, deviation of its texels</h2><img src=mean.png>",
    ]
    parts += [
        f"<h2>{kind.capitalize()} modes: -2 standard deviations, mean, +2</h2><img src={kind}.png>"
        for kind in ("combined", "shape", "texture")
    ]
    if has_charts():
        parts.append("<h2>Variance of the modes</h2><img src=variance.svg>")
    else:
        parts.append(f"<p>{escape(NEEDED)}</p>")
    parts += [
        "<h2>A search by additive steps: landmarks, texture, model, difference, face</h2>"
        "<img src=search.png>",
        "<h2>Weights of the additive matrix: first combined modes; pose</h2><img src=weights.png>",
        "<h2>Share of the texture that is not explained, by person</h2>",
        f"<table><tr><th>person<th>faces<th>residual<th>{rows}</table>",
    ]
    return "\n".join(parts) + "\n"
