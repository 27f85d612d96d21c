"""Fits the layer coefficients of a frame: the least squared error around the face, Gauss-Newton."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from encoder.layers.displacement import dense, dot, origins, sample
from encoder.layers.layer_samples import (
    LayerSamples,
    coarse_luma,
    face_region,
    motion_with_head,
)
from encoder.layers.light import fit_light, lit, unlit
from encoder.layers.scene_motion import (
    blurred,
    fit_scene_motion,
    gradient,
    halved,
    is_explained,
    left_of,
    scene_basis,
    scene_origins,
    solved,
)
from protocol.pictures.layered_background import SCENE_COEFFICIENTS
from shared_model.animate import Face
from shared_model.layers.head_motion import BackgroundMesh
from shared_model.layers.light import PIVOT_GREY, UNIT_GAIN, UNIT_GREY, light_of
from shared_model.parameters import FaceParameters

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Picture = NDArray[np.uint8]

# Gauss-Newton steps; residuals of so many grey levels count half.
STEPS, ROBUST_GREY = 3, 12.0
# Share of a frame that must show the scene for it to tell the light alone.
MIN_SCENE_SHARE = 0.1
# Matte from which on a pixel is the person's; the least change from frame to frame that counts.
PERSON_MATTE, MIN_CHANGE_GREY = 0.5, 0.05


class _Drawn(NamedTuple):
    """A coarse picture and what it is made of.

    picture: (h, w) luma.  at: (h, w, 2) where the person comes from.  alpha: (h, w) of the person.
    moves: (k, h, w, 2) coarse pixels, of each field.  changes: (c, h, w) luma, of each change.
    scene: (h, w) luma.  moving: (s, h, w) its derivatives by its motion.
    """

    picture: Single
    at: Single
    alpha: Single
    moves: Single
    changes: Single
    scene: Single
    moving: Single


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
    # Of person, alpha and scene, as `gradient` has them.
    _gradients: tuple[Single, Single, Single] = field(init=False, repr=False)
    # What takes the first steps; None: the fitter itself.
    _smoothed: "LayerFitter | None" = field(init=False, repr=False)

    def __post_init__(self) -> None:
        gradients = gradient(self.person), gradient(self.alpha), gradient(self.scene)
        object.__setattr__(self, "_gradients", gradients)
        object.__setattr__(self, "_smoothed", self._smooth() if self.start_sigma else None)

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

        parameters: of the face.  outline_px: (n, 2) of the face, source pixels.
        """
        luma, at = coarse_luma(picture), self._origins(parameters)
        weight = (~self.face_region(outline_px)).astype(np.float32)
        light = np.zeros(0)
        if self.follows_light:
            alpha = sample(self.alpha, at)
            at_rest = (1 - alpha) * self.scene + sample(self.person, at)
            light = _fit_scene_light(at_rest, alpha, luma, weight)
        normalised = unlit(luma, light_of(light)) if light.any() else luma
        start = self._fit_start(normalised, parameters, at, weight, outline_px)
        coefficients = self._fit_motion(start, normalised, at, weight)
        if light.any():
            drawn = self._drawn(at, coefficients)
            light = _fit_scene_light(drawn.picture, drawn.alpha, luma, weight)
        return np.append(coefficients, light)

    def _fit_start(
        self,
        luma: Single,
        parameters: FaceParameters,
        at: Single,
        weight: Single,
        outline_px: Array,
    ) -> Array:
        """(k + c + s,) where the fit of a frame in the light of the layers begins."""
        coefficients, smoothed = np.zeros(len(self.limits)), self._smoothed
        if self.scene_moves:
            behind = weight * (1 - sample(self.alpha, at))
            coefficients[-SCENE_COEFFICIENTS:] = fit_scene_motion(self.scene, luma, behind)
        if smoothed is None:
            return coefficients
        outside = (~smoothed.face_region(outline_px)).astype(np.float32)
        smooth, at = self._smoothed_half(luma), smoothed._origins(parameters)
        return smoothed._refined(coefficients, smooth, at, outside)

    def _fit_motion(self, start: Array, luma: Single, at: Single, weight: Single) -> Array:
        """(k + c + s,) the coefficients of a frame in the light of the layers."""
        if not len(start):
            return start
        coefficients = self._refined(start, luma, at, weight)
        if self.start_sigma and self.scene_moves:
            return self._doubted(coefficients, luma, at, weight)
        return coefficients

    def _refined(self, coefficients: Array, luma: Single, at: Single, weight: Single) -> Array:
        """The coefficients of a frame after some Gauss-Newton steps.  weight: (h, w)."""
        for _ in range(STEPS):
            drawn, jacobian = self._linearised(at, coefficients)
            residual = luma - drawn
            distrust = np.asarray(cv2.blur(residual, (3, 3)), np.float32) / ROBUST_GREY
            step = solved(jacobian, residual, weight / (1 + distrust**2))
            coefficients = np.clip(coefficients + step, *self.limits.T)
        return coefficients

    def _doubted(self, coefficients: Array, luma: Single, at: Single, weight: Single) -> Array:
        """The coefficients, with a scene at rest unless its motion explains much of a frame."""
        at_rest = coefficients.copy()
        at_rest[-SCENE_COEFFICIENTS:] = 0
        moving, still = self._drawn(at, coefficients), self._drawn(at, at_rest)
        behind = weight * (1 - moving.alpha)
        left, before = (left_of(luma, each.picture, behind) for each in (moving, still))
        return coefficients if is_explained(left, before) else at_rest

    def draw(self, parameters: FaceParameters, coefficients: Array) -> Single:
        """(h, w) the coarse luma of a frame, without the face."""
        drawn = self._drawn(self._origins(parameters), coefficients[: len(self.limits)]).picture
        return lit(drawn, light_of(coefficients[len(self.limits) :]))

    def jacobian(self, parameters: FaceParameters, coefficients: Array) -> Single:
        """(k + c + s + l, h, w) grey levels of the coarse picture per unit of each coefficient."""
        motion, light = np.split(coefficients, [len(self.limits)])
        drawn, rows = self._linearised(self._origins(parameters), motion)
        if not self.follows_light:
            return rows
        by_light = UNIT_GAIN * (drawn - PIVOT_GREY), np.full_like(drawn, UNIT_GREY)
        return np.concatenate([light_of(light).gain * rows, by_light]).astype(np.float32)

    def sensitivity(
        self, parameters: FaceParameters, coefficients: Array
    ) -> tuple[Single, Single, Single]:
        """Where the person comes from, the coarse picture, and what moving the person changes.

        Returns (h, w, 2) coarse pixels, before the fields; (h, w) luma; and (h, w, 2) grey levels
        per coarse pixel of the position at which the person is sampled.
        """
        at = self._origins(parameters)
        drawn = self._drawn(at, coefficients)
        return at, drawn.picture, self._slope(drawn)

    def face_region(self, outline_px: Array) -> NDArray[np.bool_]:
        """(h, w) where the coarse picture shows the face.  outline_px: see `fit`."""
        return face_region(outline_px, self.size, (self.scene.shape[0], self.scene.shape[1]))

    def _origins(self, parameters: FaceParameters) -> Single:
        motion = motion_with_head(self.mesh, self.face, parameters)
        shape = self.scene.shape[0], self.scene.shape[1]
        return origins(dense(motion, self.size, shape))

    def _linearised(self, at: Single, coefficients: Array) -> tuple[Single, Single]:
        """The picture and its derivatives (k + c + s, h, w).  at: see `_drawn`."""
        drawn = self._drawn(at, coefficients)
        by_fields = -dot(drawn.moves, self._slope(drawn))
        by_scene = (1 - drawn.alpha) * drawn.moving
        jacobian = np.concatenate([by_fields, drawn.changes, by_scene])
        return drawn.picture, np.asarray(jacobian, np.float32)

    def _slope(self, drawn: _Drawn) -> Single:
        """(h, w, 2) the derivative of a picture by the position of the person."""
        of_person, of_alpha, _ = self._gradients
        slope = sample(of_person, drawn.at)
        slope -= drawn.scene[..., None] * sample(of_alpha, drawn.at)
        return slope

    def _drawn(self, at: Single, coefficients: Array) -> _Drawn:
        """The picture with these coefficients.  The person comes from `at` (h, w, 2)."""
        count, changed = len(self.fields), len(self.fields) + len(self.changes)
        scene, scene_changes, moving = self._moved_scene(coefficients[changed:])
        moves = np.array([sample(each, at) for each in self.fields], np.float32)
        moves = moves.reshape(-1, *at.shape)
        at = at - np.tensordot(coefficients[:count].astype(np.float32), moves, 1)
        person, alpha = sample(self.person, at), sample(self.alpha, at)
        added = coefficients[count:changed].astype(np.float32)
        own_changes = np.array([sample(change, at) for change in self.changes], np.float32)
        changes = (1 - alpha) * scene_changes + alpha * own_changes.reshape(-1, *alpha.shape)
        drawn = (1 - alpha) * scene + person + np.tensordot(added, changes, 1)
        picture = np.asarray(drawn, np.float32)
        return _Drawn(picture, at, alpha, moves, changes, scene, moving)

    def _moved_scene(self, own: Array) -> tuple[Single, Single, Single]:
        """(h, w) the scene, (c, h, w) its changes, and (s, h, w) derivatives by its motion.

        own: (s,) coefficients of the scene's motion.
        """
        shape = self.scene.shape[0], self.scene.shape[1]
        if not len(own):
            return self.scene, self.changes, np.zeros((0, *shape), np.float32)
        basis = scene_basis(shape)
        at = scene_origins(basis, own)
        changes = np.array([sample(change, at) for change in self.changes], np.float32)
        derivatives = -dot(basis, sample(self._gradients[2], at))
        return sample(self.scene, at), changes.reshape(-1, *shape), derivatives


def _fit_scene_light(picture: Single, alpha: Single, luma: Single, weight: Single) -> Array:
    """(2,) the light of a frame, by its scene if that is large enough.

    picture, alpha: (h, w) as drawn, and of the person.  luma, weight: (h, w) of the frame.
    """
    behind = weight * (1 - alpha)
    return fit_light(picture, luma, behind if behind.mean() > MIN_SCENE_SHARE else weight)


def flicker_ratio(samples: LayerSamples, fitter: LayerFitter, coefficients: Array) -> float:
    """The change behind the person from one frame of a sample to the next, drawn over true.

    coefficients: of each frame.  What the person moves over is left out.
    """
    shape = fitter.scene.shape[0], fitter.scene.shape[1]
    mattes = samples.mattes_at(shape)
    frames = zip(samples.pictures, samples.faces, coefficients, strict=True)
    pairs = [(coarse_luma(picture), fitter.draw(face, own)) for picture, face, own in frames]
    covered = [
        (matte > PERSON_MATTE) | fitter.face_region(outline)
        for matte, outline in zip(mattes, samples.outlines_px, strict=True)
    ]
    change = np.zeros(2)
    for i in range(1, len(pairs)):
        behind = ~covered[i - 1] & ~covered[i]
        before, after = pairs[i - 1], pairs[i]
        if behind.any():
            change += [np.abs(b - a)[behind].mean() for a, b in zip(before, after, strict=True)]
    true, drawn = change / max(len(pairs) - 1, 1)
    return float(drawn / max(true, MIN_CHANGE_GREY))
