"""Training (thesis 2.4.2 to 2.4.3): from faces with known parameters to a model."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from aam.model import AppearanceModel, MultiResolutionModel, texture_at
from aam.pca import LinearModel, components_under_metric, principal_components, without_first
from aam.texture_frame import FRAMES
from aam.training.cascade import SearchStates, finer_states, first_states, train_stage
from aam.training.drawn_displacements import regressed_matrix
from aam.training.faces import AnnotatedFace, TrainingFace, at_resolution, mirrored_face
from aam.training.prediction import additive_matrix, project_out_matrix
from aam.warps import Warp, head_warp
from encoder.appearance.photometric import NORMALISATIONS
from runtime.parallel import parallel_map
from shared_model.arrays import Array, Single

# Is told what is done and what share of all, 0..1.
Progress = Callable[[float], None]

# Texels a side of the finest level, and those of the levels before it.
SIZES = {64: (32, 64), 128: (32, 64, 128), 256: (32, 64, 128, 256)}
# For each size: stages of the cascade, starts of each face, share of the work.
STAGES = {32: 4, 64: 3, 128: 2, 256: 1}
REPEATS = {32: 12, 64: 8, 128: 4, 256: 2}
WORK = {32: 1.0, 64: 1.5, 128: 2.5, 256: 3.0}
# Faces over which derivatives are averaged, at most.
DIFFERENTIATED_FACES = 60
FEWEST_FACES = 4
# How far to the sides a shape is looked at, and the step of its differences.
SIDE_RAD, METRIC_STEP = 0.5, 1e-3


@dataclass(frozen=True, slots=True)
class TrainingOptions:
    """How a model is trained.

    size: texels a side of the finest level, see `SIZES`.  frame: see `texture_frame`.
    retained: share of the variance that the modes of shape, texture and both keep (eq. 2.21).
    shape_retained: the same of the shape alone, if it is another.
    discard: number of first combined modes that are left out (2.4.4).
    discard_texture: the same of the texture, before both are combined (5.3).
    shape_weight: factor on W_s; 1: the ratio of the variances (2.4.2).
    normalisation: see `normalised_luma`.  mirror: train on mirror images as well.
    cascade: train the cascade of matrices too, which takes most of the time.
    regression: train the regressed matrix too, beside that of eq. 2.27.
    seed: of what is drawn at random.
    """

    size: int = 128
    frame: str = "full"
    retained: float = 0.92
    shape_retained: float | None = None
    discard: int = 0
    discard_texture: int = 0
    shape_weight: float = 1.0
    normalisation: str = "retinex"
    mirror: bool = True
    cascade: bool = True
    regression: bool = True
    seed: int = 1

    def __post_init__(self) -> None:
        allowed = {"size": tuple(SIZES), "frame": FRAMES, "normalisation": tuple(NORMALISATIONS)}
        for name, values in allowed.items():
            if getattr(self, name) not in values:
                raise ValueError(f"{name} is {getattr(self, name)!r}, expected one of {values}")


def train(
    faces: Sequence[AnnotatedFace],
    options: TrainingOptions,
    progress: Progress = lambda share: None,
) -> MultiResolutionModel:
    """A model of the 3D head from annotated faces.

    Raises `ValueError` for fewer than four faces, for those of one person, or where `discard` or
    `discard_texture` leaves no mode.
    """
    if len(faces) < FEWEST_FACES or len({face.person for face in faces}) < 2:
        raise ValueError(f"{len(faces)} faces, expected {FEWEST_FACES} of two people at least")
    whole = [*faces, *map(mirrored_face, faces)] if options.mirror else list(faces)
    sizes = SIZES[options.size]
    warps = [head_warp(size, options.frame) for size in sizes]
    random = np.random.default_rng(options.seed)
    levels = train_levels(whole, warps, options, random, progress)
    return MultiResolutionModel(options.frame, options.normalisation, sizes, levels)


def train_levels(
    faces: Sequence[AnnotatedFace],
    warps: Sequence[Warp],
    options: TrainingOptions,
    random: np.random.Generator,
    progress: Progress,
) -> tuple[AppearanceModel, ...]:
    """A model at each resolution, from coarse to fine, with all prediction matrices."""
    levels: list[AppearanceModel] = []
    states: SearchStates | None = None
    before: list[TrainingFace] = []
    total, done = sum(WORK[warp.size] for warp in warps), 0.0
    for warp in warps:
        prepared = at_resolution(faces, warp.size, options.normalisation)
        model, truth = combined_model(prepared, warp, options)
        repeats = REPEATS[warp.size]
        if states is None:
            states = first_states(model, warp, prepared, repeats, random)
        else:
            sides = zip(prepared, before, strict=True)
            ratios = np.array([len(face.luma) / len(coarse.luma) for face, coarse in sides])
            states = finer_states(levels[-1], model, warp, prepared, states, ratios, repeats)
        matrices = []
        stages = STAGES[warp.size] if options.cascade else 0
        for stage in range(stages):
            matrix, states = train_stage(model, warp, prepared, truth, states)
            matrices.append(matrix)
            progress((done + 0.8 * (stage + 1) / stages * WORK[warp.size]) / total)
        levels.append(_with_matrices(model, warp, prepared, truth, matrices, options))
        before = prepared
        done += WORK[warp.size]
        progress(done / total)
    return tuple(levels)


def combined_model(
    faces: Sequence[TrainingFace], warp: Warp, options: TrainingOptions
) -> tuple[AppearanceModel, Array]:
    """Modes of shape and texture together (eq. 2.17 to 2.19), without prediction matrices, and
    the combined parameters (faces, M) of the faces.
    """
    shapes = np.array([face.shape for face in faces])
    textures = np.array(
        parallel_map(lambda face: texture_at(warp, face.luma, face.shape, face.pose), faces, None)
    )
    metric = visible_metric(warp, shapes.mean(0))
    retained = options.retained if options.shape_retained is None else options.shape_retained
    shape = components_under_metric(shapes, retained, metric)
    texture = principal_components(textures.astype(np.float64), options.retained)
    texture = _without(texture, options.discard_texture, "discard_texture")
    texture = replace(texture, modes=texture.modes.astype(np.float32))
    weight = options.shape_weight * float(np.sqrt(texture.total / max(shape.total, 1e-12)))
    p_s, p_g = shape.coefficients(shapes), texture.coefficients(textures)
    both = principal_components(np.hstack([weight * p_s, p_g]), options.retained, centred=False)
    both = _without(both, options.discard, "discard")
    empty = np.zeros((0, 0), np.float32)
    none = np.zeros((0, len(warp.pose_names) + len(both.modes), len(warp.rows)), np.float32)
    model = AppearanceModel(
        shape, texture, weight, both, (0.0, 0.0), none, empty, empty, none[0:0, 0]
    )
    truth = model.parameters_of(shapes, textures)
    left = textures - model.texture_of(truth)
    explained = 1 - (left**2).mean(1)
    return replace(model, contrast=(float(explained.mean()), float(explained.std()))), truth


def _without(model: LinearModel, count: int, option: str) -> LinearModel:
    """The model without its first modes.  Raises `ValueError` if none are left."""
    if count >= len(model.modes):
        raise ValueError(f"{option} is {count}, expected less than all {len(model.modes)}")
    return without_first(model, count)


def visible_metric(warp: Warp, shape: Array) -> Array:
    """(n, n): the mean square by which a change of a shape (n,) moves its landmarks, seen from the
    front and from the sides.

    Actuators do not move a face equally far, and some of them nearly cancel each other.
    """
    poses, front = len(warp.pose_names), warp.upright(0.0, np.zeros(3))
    turns = [
        sign * SIDE_RAD * np.eye(poses)[index] for index in range(poses - 3) for sign in (-1, 1)
    ]
    views = [front, *(warp.displaced(front, turn) for turn in turns)]
    total = np.zeros((len(shape), len(shape)))
    for view in views:
        moves = [
            warp.landmarks(shape + step, view) - warp.landmarks(shape - step, view)
            for step in METRIC_STEP * np.eye(len(shape))
        ]
        jacobian = np.array(moves).reshape(len(shape), -1) / (2 * METRIC_STEP)
        total += jacobian @ jacobian.T / (jacobian.shape[1] / 2)
    return total / len(views)


def _with_matrices(
    model: AppearanceModel,
    warp: Warp,
    faces: Sequence[TrainingFace],
    truth: Array,
    cascade: Sequence[Single],
    options: TrainingOptions,
) -> AppearanceModel:
    chosen = np.linspace(0, len(faces) - 1, min(len(faces), DIFFERENTIATED_FACES)).astype(int)
    some = [faces[index] for index in chosen]
    regressed = model.regressed
    if options.regression:
        random = np.random.default_rng(options.seed)
        regressed = regressed_matrix(model, warp, faces, truth, random)
    return replace(
        model,
        cascade=np.array(cascade) if cascade else model.cascade,
        regressed=regressed,
        additive=additive_matrix(model, warp, some, truth[chosen]),
        project_out=project_out_matrix(model, warp, some),
    )
