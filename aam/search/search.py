"""Search at one resolution (thesis 3.1): pose and combined parameters that explain a picture."""

from dataclasses import dataclass, replace

import numpy as np

from aam.model import AppearanceModel, residual, texture_at
from aam.warps import Warp
from shared_model.arrays import Array, Single

METHODS = ("cascade", "regression", "additive", "project-out")


@dataclass(frozen=True, slots=True)
class SearchOptions:
    """How a search goes.

    method: "cascade": the trained stages, one after the other, then additive steps; or additive
        steps from the start, whichever leaves the smaller residual.
        "regression": steps by the regressed matrix, which sees farther, and then additive ones.
        "additive": the thesis' scheme, steps by one matrix, that of eq. 2.27.
        "project-out": inverse-compositional steps of pose and shape; the texture follows.
    iterations: at most, of one matrix.
    forced: first iterations whose step is taken whatever the error becomes.
    damping: shares of a predicted step, in the order in which they are tried.
    limit: bound of each combined parameter, standard deviations.
    tolerance: relative gain below which the search ends.
    """

    method: str = "cascade"
    iterations: int = 10
    forced: int = 1
    damping: tuple[float, ...] = (1.0, 1.5, 0.5, 0.25)
    limit: float = 3.0
    tolerance: float = 1e-3

    def __post_init__(self) -> None:
        if self.method not in METHODS:
            raise ValueError(f"method is {self.method!r}, expected one of {METHODS}")


@dataclass(frozen=True, slots=True)
class SearchResult:
    """pose: (p,) and c: (M,) of the end.  error: mean square residual of the normalised textures.
    path: poses and c of each iteration, the start first.
    """

    pose: Array
    c: Array
    error: float
    path: tuple[tuple[Array, Array], ...]


def search(
    model: AppearanceModel, warp: Warp, luma: Single, pose: Array, c: Array, options: SearchOptions
) -> SearchResult:
    """Pose and c near a start that explain a picture.

    luma: (h, w) normalised.  pose: (p,) in its pixels.  c: (M,).
    """
    if options.method == "cascade":
        return _cascade(model, warp, luma, pose, c, options)
    if options.method == "regression":
        return _regression(model, warp, luma, pose, c, options)
    if options.method == "additive":
        return _stepwise(model, model.additive, warp, luma, pose, c, options)
    return _project_out(model, warp, luma, pose, c, options)


def _cascade(
    model: AppearanceModel, warp: Warp, luma: Single, pose: Array, c: Array, options: SearchOptions
) -> SearchResult:
    bound, path = options.limit * model.deviations, [(pose, c)]
    at, parameters = pose, c
    for matrix in model.cascade:
        step = (matrix @ residual(model, warp, luma, at, parameters)).astype(np.float64)
        at = warp.displaced(at, step[: len(at)])
        parameters = np.clip(parameters + step[len(at) :], -bound, bound)
        path.append((at, parameters))
    unforced = replace(options, forced=0)
    polished = _stepwise(model, model.additive, warp, luma, at, parameters, unforced)
    direct = _stepwise(model, model.additive, warp, luma, pose, c, options)
    if direct.error < polished.error:
        return direct
    return replace(polished, path=(*path, *polished.path[1:]))


def _regression(
    model: AppearanceModel, warp: Warp, luma: Single, pose: Array, c: Array, options: SearchOptions
) -> SearchResult:
    far = _stepwise(model, model.regressed, warp, luma, pose, c, options)
    unforced = replace(options, forced=0)
    near = _stepwise(model, model.additive, warp, luma, far.pose, far.c, unforced)
    return replace(near, path=(*far.path, *near.path[1:]))


def _stepwise(
    model: AppearanceModel,
    matrix: Single,
    warp: Warp,
    luma: Single,
    pose: Array,
    c: Array,
    options: SearchOptions,
) -> SearchResult:
    """Steps 1 to 6 of thesis 3.1, by one matrix (p + M, k)."""
    bound, path = options.limit * model.deviations, [(pose, c)]
    at = residual(model, warp, luma, pose, c)
    error = float((at**2).mean())
    best = SearchResult(pose, c, error, ())
    for number in range(options.iterations):
        step = -(matrix @ at).astype(np.float64)
        for share in options.damping:
            trial_pose = warp.displaced(pose, share * step[: len(pose)])
            trial_c = np.clip(c + share * step[len(pose) :], -bound, bound)
            trial = residual(model, warp, luma, trial_pose, trial_c)
            trial_error = float((trial**2).mean())
            if trial_error < error or number < options.forced:
                break
        else:
            break
        gain = 1 - trial_error / max(error, 1e-12)
        pose, c, at, error = trial_pose, trial_c, trial, trial_error
        path.append((pose, c))
        if error < best.error:
            best = SearchResult(pose, c, error, ())
        if number >= options.forced and gain < options.tolerance:
            break
    return SearchResult(best.pose, best.c, best.error, tuple(path))


def _project_out(
    model: AppearanceModel, warp: Warp, luma: Single, pose: Array, c: Array, options: SearchOptions
) -> SearchResult:
    bound = options.limit * np.sqrt(model.shape.variances)
    p_s = np.clip(model.shape.coefficients(model.shape_of(c)), -bound, bound)
    mean = model.texture.mean.astype(np.float32)
    modes = model.texture.modes.astype(np.float32)
    path: list[tuple[Array, Array]] = [(pose, c)]
    best: tuple[float, Array, Array] | None = None
    for number in range(options.iterations + 1):
        shape = model.shape.values(p_s)
        texture = texture_at(warp, luma, shape, pose)
        left = texture - mean
        left = left - (modes @ left) @ modes
        error = float((left**2).mean())
        c = _within(model, model.parameters_of(shape, texture), options.limit)
        if number:
            path.append((pose, c))
        gain = 1.0 if best is None else 1 - error / max(best[0], 1e-12)
        if best is None or gain > 0:
            best = error, pose, c
        if number > options.forced and gain < options.tolerance:
            break
        step = (model.project_out @ left).astype(np.float64)
        pose = warp.displaced(pose, step[: len(pose)])
        p_s = np.clip(p_s + step[len(pose) :], -bound, bound)
    assert best is not None
    error = float((residual(model, warp, luma, best[1], best[2]) ** 2).mean())
    return SearchResult(best[1], best[2], error, tuple(path))


def _within(model: AppearanceModel, c: Array, limit: float) -> Array:
    return np.asarray(np.clip(c, -limit * model.deviations, limit * model.deviations))
