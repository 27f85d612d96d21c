"""Fits the layer coefficients of a frame: the least squared error around the face, Gauss-Newton."""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from encoder.capture.colour import luma_f32
from encoder.fitting.gauss_newton import Equations, gauss_newton
from encoder.layers.displacement import dense, origins, sample
from encoder.layers.layer_drawing import DrawnLayers, draw_layers
from encoder.layers.layer_samples import (
    CoarseFrame,
    face_region,
    motion_with_head,
    shrunk,
)
from encoder.layers.light import fit_light, lit, unlit
from encoder.layers.scene_motion import (
    ScenePyramid,
    coarse_equations,
    fit_scene_motion,
    gradient,
    halved,
    is_explained,
    residual_energy,
    scene_basis,
    scene_pyramid,
)
from protocol.pictures.layered_background import SCENE_COEFFICIENTS
from runtime.cauchy_weight import cauchy_weight
from runtime.image_ops import blurred
from shared_model.animate import Face
from shared_model.arrays import Array, Mask, Picture, Single
from shared_model.layers.head_motion import BackgroundMesh
from shared_model.layers.light import PIVOT_GREY, UNIT_GAIN, UNIT_GREY, light_of
from shared_model.parameters import FaceParameters

# Gauss-Newton steps, at most, and of a fit that starts from the frame before.  One that takes less
# than this from the squared residual, squared grey levels per pixel, is the last.
STEPS, FOLLOWING_STEPS, MIN_DECREASE_GREY2 = 8, 3, 0.02
UNKNOWN: Array = np.zeros(0)
# Share of a frame that must show the scene for it to tell the light alone.
MIN_SCENE_SHARE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class LayerFitter:
    """The coarse picture around the face as a function of the layer coefficients.

    face, mesh: of the person, see `motion_with_head`.  size: of the source, (width, height).
    person: (h, w) luma, times alpha.  alpha: (h, w).  scene: (h, w) luma.
    fields: (k, h, w, 2) coarse pixels.  changes: (c, h, w) luma.
    limits: (k + c + s, 2) the least and the largest coefficients, without those of the light.
    scene_moves: s is 4, and coefficients move the scene (`scene_motion`); else s is 0.
    follows_light: l is 2, and the last coefficients are of the light (`light`); else l is 0.
    start_sigma: standard deviation, coarse pixels, of the kernel that smooths all pictures for the
        first steps, in a model of which large motion is not known; its scene moves in a frame only
        if that explains much of it.  0: of a model that has been learned from motion.
    """

    face: Face
    mesh: BackgroundMesh
    size: tuple[int, int]
    person: Single
    alpha: Single
    scene: Single
    fields: Single
    changes: Single
    limits: Array
    scene_moves: bool = False
    start_sigma: float = 0.0
    follows_light: bool = False
    # Person, alpha, scene and changes as `draw_layers` takes them.
    _packed: tuple[Single, Single, Single, Single] = field(init=False, repr=False)
    # Of a scene that moves.
    _pyramid: ScenePyramid = field(init=False, repr=False)
    # What takes the first steps; None: the fitter itself.
    _smoothed: "LayerFitter | None" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_packed", self._pack())
        pyramid = scene_pyramid(self.scene) if self.scene_moves else ()
        object.__setattr__(self, "_pyramid", pyramid)
        object.__setattr__(self, "_smoothed", self._smooth() if self.start_sigma else None)

    def _pack(self) -> tuple[Single, Single, Single, Single]:
        images = self.person, self.alpha, self.scene
        person, opaque, scene = (np.dstack([each, gradient(each)]) for each in images)
        return person, opaque, scene, np.ascontiguousarray(self.changes.transpose(1, 2, 0))

    def _smooth(self) -> "LayerFitter":
        """The same of smooth pictures, half as large in each direction."""
        images = self.person, self.alpha, self.scene
        person, alpha, scene = (self._smoothed_half(each) for each in images)
        fields = [halved(field) / 2 for field in self.fields]
        changes = [halved(change) for change in self.changes]
        return replace(
            self,
            person=person,
            alpha=alpha,
            scene=scene,
            fields=np.array(fields, np.float32).reshape(-1, *scene.shape, 2),
            changes=np.array(changes, np.float32).reshape(-1, *scene.shape),
            start_sigma=0.0,
        )

    def _smoothed_half(self, image: Single) -> Single:
        return halved(blurred(image, self.start_sigma))

    def fit(self, picture: Picture, parameters: FaceParameters, outline_px: Array) -> Array:
        """(k + c + s + l,) the coefficients of a frame (h, w, 3) uint8 BGR.

        parameters: of the face; if they have layer coefficients, those of the frame before, the fit
            starts from them.
        outline_px: (n, 2) of the face, source pixels.
        """
        luma = luma_f32(shrunk(picture, (self.scene.shape[0], self.scene.shape[1])))
        motion = motion_with_head(self.mesh, self.face, parameters)
        frame = self._placed(luma, motion, outline_px)
        light = np.zeros(0)
        if self.follows_light:
            alpha = sample(self.alpha, frame.origins)
            at_rest = (1 - alpha) * self.scene + sample(self.person, frame.origins)
            light = _fit_scene_light(at_rest, alpha, frame)
        normalised = frame
        if light.any():
            normalised = replace(frame, luma=unlit(frame.luma, light_of(light)))
        smoothed, smooth = self._smoothed, None
        is_known = len(parameters.layers) == len(self.limits) + len(light)
        before = parameters.layers[: len(self.limits)] if is_known else UNKNOWN
        if smoothed is not None and not before.any():
            luma = self._smoothed_half(normalised.luma)
            smooth = smoothed._placed(luma, motion, outline_px)
        coefficients = self.fit_motion(normalised, smooth, before)
        if light.any():
            drawn = self._drawn(frame.origins, coefficients)
            light = _fit_scene_light(drawn.picture, drawn.alpha, frame)
        return np.append(coefficients, light)

    def _placed(self, luma: Single, motion: Array, outline_px: Array) -> CoarseFrame:
        """A frame (h, w).  motion: of the person, see `dense`.  outline_px: see `fit`."""
        outside = (~self.face_region(outline_px)).astype(np.float32)
        return CoarseFrame(luma, self._origins(motion), outside)

    def fit_motion(
        self, frame: CoarseFrame, smooth: CoarseFrame | None = None, before: Array = UNKNOWN
    ) -> Array:
        """(k + c + s,) the coefficients of a frame in the light of the layers.

        smooth: the same for the first steps, see `start_sigma`.
        before: the coefficients to start from; none or zeros: they are not known.
        """
        coefficients, smoothed = np.zeros(len(self.limits)), self._smoothed
        if not len(coefficients):
            return coefficients
        if before.any():
            coefficients = before
        elif self.scene_moves:
            motion = frame.scene_motion
            motion = self._scene_motion(frame) if motion is None else motion
            coefficients[-SCENE_COEFFICIENTS:] = motion
        if smoothed is not None and smooth is not None:
            moves = smoothed._moves(smooth.origins)
            coefficients = smoothed._refined(coefficients, smooth, moves)
        moves = self._moves(frame.origins)
        steps = FOLLOWING_STEPS if before.any() else STEPS
        coefficients = self._refined(coefficients, frame, moves, steps)
        if self.start_sigma and self.scene_moves:
            return self._doubted(coefficients, frame, moves)
        return coefficients

    def with_scene_motion(self, frame: CoarseFrame) -> CoarseFrame:
        """A frame with the scene's motion, for fits with this person and scene, whatever else."""
        return replace(frame, scene_motion=self._scene_motion(frame)) if self.scene_moves else frame

    def _scene_motion(self, frame: CoarseFrame) -> Array:
        behind = frame.outside * (1 - sample(self.alpha, frame.origins))
        return fit_scene_motion(self._pyramid, frame.luma, behind)

    def _refined(
        self, coefficients: Array, frame: CoarseFrame, moves: Single, steps: int = STEPS
    ) -> Array:
        """The coefficients of a frame after some Gauss-Newton steps.  moves: see `_moves`."""

        def equations(coefficients: Array) -> Equations:
            drawn = self._drawn(frame.origins, coefficients, moves)
            residual = frame.luma - drawn.picture
            around = np.asarray(cv2.blur(residual, (3, 3)), np.float32)
            weight = cauchy_weight(around, weight=frame.outside)
            return coarse_equations(drawn.rows, residual, weight)

        def moved(coefficients: Array, step: Array) -> Array:
            return np.clip(coefficients + step, *self.limits.T)

        enough = MIN_DECREASE_GREY2 * frame.luma.size
        return gauss_newton(equations, coefficients, moved, steps, enough)

    def _doubted(self, coefficients: Array, frame: CoarseFrame, moves: Single) -> Array:
        """The coefficients, with a scene at rest unless its motion explains much of a frame.

        moves: see `_moves`.
        """
        at_rest = coefficients.copy()
        at_rest[-SCENE_COEFFICIENTS:] = 0
        moving, still = (self._drawn(frame.origins, own, moves) for own in (coefficients, at_rest))
        behind = frame.outside * (1 - moving.alpha)
        left, before = (
            residual_energy(frame.luma, each.picture, behind) for each in (moving, still)
        )
        return coefficients if is_explained(left, before) else at_rest

    def draw(self, parameters: FaceParameters, coefficients: Array) -> Single:
        """(h, w) the coarse luma of a frame, without the face."""
        return self.draw_at(self._origins_of(parameters), coefficients)

    def draw_at(self, at: Single, coefficients: Array) -> Single:
        """The same.  at: (h, w, 2) the origins of a frame, see `CoarseFrame`."""
        motion, light = np.split(coefficients, [len(self.limits)])
        return lit(self._drawn(at, motion).picture, light_of(light))

    def jacobian(self, parameters: FaceParameters, coefficients: Array) -> Single:
        """(k + c + s + l, h, w) grey levels of the coarse picture per unit of each coefficient."""
        motion, light = np.split(coefficients, [len(self.limits)])
        layers = self._drawn(self._origins_of(parameters), motion)
        drawn, rows = layers.picture, layers.rows
        if not self.follows_light:
            return rows
        by_light = UNIT_GAIN * (drawn - PIVOT_GREY), np.full_like(drawn, UNIT_GREY)
        return np.concatenate([light_of(light).gain * rows, by_light]).astype(np.float32)

    def sensitivity(self, at: Single, coefficients: Array) -> tuple[Single, Single]:
        """The coarse picture, and what moving the person changes.  at: see `draw_at`.

        Returns (h, w) luma and (h, w, 2) grey levels per coarse pixel of the position at which the
        person is sampled.
        """
        drawn = self._drawn(at, coefficients)
        return drawn.picture, drawn.slope

    def face_region(self, outline_px: Array) -> Mask:
        """(h, w) where the coarse picture shows the face.  outline_px: see `fit`."""
        return face_region(outline_px, self.size, (self.scene.shape[0], self.scene.shape[1]))

    def _origins_of(self, parameters: FaceParameters) -> Single:
        return self._origins(motion_with_head(self.mesh, self.face, parameters))

    def _origins(self, motion: Array) -> Single:
        """Where the person comes from, see `CoarseFrame`.  motion: see `dense`."""
        shape = self.scene.shape[0], self.scene.shape[1]
        return origins(dense(motion, self.size, shape))

    def _moves(self, at: Single) -> Single:
        """(k, h, w, 2) see `draw_layers`."""
        moves = np.empty((len(self.fields), *at.shape), np.float32)
        for number, each in enumerate(self.fields):
            moves[number] = sample(each, at)
        return moves

    def _drawn(self, at: Single, coefficients: Array, moves: Single | None = None) -> DrawnLayers:
        """The picture with these coefficients.  The person comes from `at` (h, w, 2).

        moves: see `_moves`.
        """
        shape = self.scene.shape[0], self.scene.shape[1]
        is_moving = len(coefficients) > len(self.fields) + len(self.changes)
        basis = scene_basis(shape) if is_moving else np.zeros((0, *shape, 2), np.float32)
        moves = self._moves(at) if moves is None else moves
        return draw_layers(*self._packed, at, moves, basis, coefficients)


def _fit_scene_light(picture: Single, alpha: Single, frame: CoarseFrame) -> Array:
    """(2,) the light of a frame, by its scene if that is large enough.

    picture, alpha: (h, w) as drawn, and of the person.
    """
    behind = frame.outside * (1 - alpha)
    used = behind if behind.mean() > MIN_SCENE_SHARE else frame.outside
    return fit_light(picture, frame.luma, used)
