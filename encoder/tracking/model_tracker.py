"""Model-based tracking (thesis 5.2): landmarks and KLT -> EKF -> analysis by synthesis -> EKF.

Each of the four can be left out; what remains still follows the face.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from encoder.capture.colour import luma_u8
from encoder.fitting.analysis_by_synthesis import (
    MIN_RESIDUAL_SIGMA_GREY,
    RESIDUAL_SIGMA_GREY,
    Observation,
)
from encoder.fitting.fit_results import IdentityFit, TextureFit
from encoder.fitting.person_texture import (
    DEFAULT_OPTIONS,
    GOOD_CORRELATION,
    MAX_ATLAS_SIZES,
    FitOptions,
    PersonTexture,
)
from encoder.fitting.pose_initialisation import pose_from_points
from encoder.tracking.detection_measurement import FrameMeasurement, FrameMeasurer
from encoder.tracking.ekf import Estimate, FaceFilter, InitialUncertainty, ProcessNoise
from encoder.tracking.identity_refinement import MIN_EYE_DISTANCE_PX, IdentityRefiner
from encoder.tracking.klt import KltTracker, Tracks, eye_distance_px
from encoder.tracking.track_loss import (
    MIN_CORRELATION,
    MIN_CORRELATION_RECOVERED,
    is_plausible,
    is_tracking_failure,
)
from shared_model.animate import Face
from shared_model.geometry import matrix_from_quaternion, pixel_from_head
from shared_model.mesh import Head
from shared_model.parameters import (
    EAU_INDEX,
    LIDS,
    FaceParameters,
    Pose,
    clip_eau,
    with_focal_change,
)

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

TRACKER_PARTS = ("network", "klt", "ekf", "abs")

# Standard deviations of what the parts measure: points in units of the distance between the eyes.
ABS_SIGMA = 0.012
# Of actuators: the fit's where it leaves as much as is usual, in proportion where it leaves less.
ABS_EAU_SIGMA = 0.06
NETWORK_EAU_SIGMA = 0.07
# The network's errors double at this angle aside of the camera.
NETWORK_WIDE_DEG = 15.0
# The fit of the textured model moves the whole face; it tells the filter by so many points.
ANCHORS = 20
# Steps of the fit, coarse and fine.
ITERATIONS = (3, 2)
RECOVERY_ITERATIONS = (8, 5)

# The fit goes on from where the face was expected unless another start explains so much more.
CLEARLY_BETTER = 0.01
# Other starts are tried in one of so many frames, and wherever the fit is poor.
OTHER_STARTS_EVERY = 4

# Lips are pulled another way up than down: a fit of the mouth's corners may halt near rest.  There,
# in one of so many frames, it also starts so far on the other side, and keeps what leaves so much
# less of the picture.
CORNERS = EAU_INDEX["mouth_corners"]
ACROSS, NEAR_REST = 0.4, 0.2
ACROSS_EVERY, MIN_IMPROVEMENT = 6, 0.02

# Frames in a row that must look bad before the face counts as lost.
LOST_AFTER_FRAMES = 3


@dataclass(frozen=True, slots=True)
class TrackedPerson:
    """Who is followed: the same from the first face on, but for a better identity at times."""

    fitted: IdentityFit
    face: Face
    textures: tuple[PersonTexture, ...]
    klt: KltTracker
    anchors: NDArray[np.int32]


class ModelTracker:
    """A `Follower` that fuses landmarks, KLT and the fit of the caller's own textured model.

    active: actuators that may move after the first frame.  elapsed_s: from frame to frame.
    sighter: finds the face at the start and when it was lost; also measures every frame unless
    "network" is left out.  without: which of `PARTS` are left out.  synthesis: how the
    textured model is fitted.  refines: whether it improves the caller's identity, which takes
    landmarks in the first frame and "abs".
    """

    def __init__(
        self,
        head: Head,
        active: Sequence[int],
        elapsed_s: float,
        measurer: FrameMeasurer,
        without: frozenset[str] = frozenset(),
        fit_options: FitOptions = DEFAULT_OPTIONS,
        refine_identity: bool = False,
    ) -> None:
        if not without <= set(TRACKER_PARTS):
            raise ValueError(
                f"without is {sorted(without)}, expected some of {', '.join(TRACKER_PARTS)}"
            )
        self._head, self._active = head, list(active)
        self._elapsed_s, self._sighter, self._without = elapsed_s, measurer, without
        self._synthesis, self._refines = fit_options, refine_identity
        self._caller: TrackedPerson | None = None
        self._refinement: IdentityRefiner | None = None
        self._filter: FaceFilter | None = None
        self._last: FaceParameters | None = None
        self._bad = self._number = 0
        self.confidence = 0.0

    @property
    def fitted(self) -> IdentityFit:
        """See `Follower`."""
        if self._caller is None:
            raise ValueError("no face has been seen, expected update before fitted")
        return self._caller.fitted

    def update(self, frame: Picture, next_frame: Picture | None = None) -> FaceParameters | None:
        """See `Follower`."""
        self._number += 1
        if self._caller is None:
            return self._begin(frame)
        if self._last is None:
            return self._recover(self._caller, frame)
        return self._follow(self._caller, self._last, frame, next_frame)

    def take_refined_identity(self) -> IdentityFit | None:
        """See `Follower`."""
        return self._refinement.take_result() if self._refinement is not None else None

    def adopt(self, fitted: IdentityFit) -> None:
        """See `Follower`."""
        if self._caller is None or self._refinement is None:
            raise ValueError("no face is followed, expected an improvement before it is adopted")
        before, face = self._caller, Face(self._head, fitted.identity)
        for texture in before.textures:
            texture.set_shape(face, fitted.camera, fitted.frames[0])
        before.klt.set_face(face)
        self._sighter.set_identity(fitted)
        self._refinement.adopt(fitted)
        self._caller = replace(before, fitted=fitted, face=face)
        if self._last is not None:
            ratio = fitted.camera.focal_px / before.fitted.camera.focal_px
            self._restart(self._caller, with_focal_change(self._last, ratio))

    def _has(self, part: str) -> bool:
        return part not in self._without

    def _begin(self, frame: Picture) -> FaceParameters | None:
        fitted = self._sighter.initialise(frame)
        if fitted is None:
            return None
        grey = luma_u8(frame)
        face, start, camera = Face(self._head, fitted.identity), fitted.frames[0], fitted.camera
        textures = tuple(
            PersonTexture(self._head, face, camera, grey, start, size, self._synthesis)
            for size in MAX_ATLAS_SIZES
        )
        klt = KltTracker(face, grey, camera, start)
        spread = np.linspace(0, len(klt.index) - 1, min(ANCHORS, len(klt.index)))
        self._caller = TrackedPerson(fitted, face, textures, klt, klt.index[spread.astype(int)])
        large_enough = eye_distance_px(camera, start.pose) > MIN_EYE_DISTANCE_PX
        if self._refines and self._has("abs") and fitted.information is not None and large_enough:
            texture = textures[-1]
            first = texture.observe(grey, start)
            self._refinement = IdentityRefiner(self._head, fitted, texture, first, self._active)
        self.confidence = 1.0
        self._restart(self._caller, start)
        return start

    def _restart(self, caller: TrackedPerson, face: FaceParameters) -> None:
        """Follow from `face` on."""
        count = len(caller.klt.index) + self._sighter.point_count + len(caller.anchors)
        # The wire has one focal length, the identity's; a filter free to change it runs away with
        # the depth, since one head shows it hardly.
        motion, doubt = ProcessNoise(focal_per_s=0.0), InitialUncertainty(focal_share=1e-6)
        camera, eau = caller.fitted.camera, face.eau[self._active]
        self._filter = FaceFilter(camera, face.pose, eau, count, motion, doubt)
        self._last, self._bad = face, 0

    def _follow(
        self,
        caller: TrackedPerson,
        last: FaceParameters,
        frame: Picture,
        next_frame: Picture | None,
    ) -> FaceParameters | None:
        predicted = self._predict(last)
        looks = self._measured_by_network()
        sight = self._sighter.measure(frame, predicted, next_frame) if looks else None
        if sight is not None and not is_plausible(sight.face, caller.fitted):
            sight = None
        # What follows looks at luma alone.
        grey, camera = luma_u8(frame), caller.fitted.camera
        tracks = caller.klt.track(grey, camera, predicted) if self._has("klt") else None
        start = self._fuse(caller, predicted, sight, tracks)
        refined = None
        if self._has("abs"):
            refined = self._refine(caller, grey, self._starts(start, sight), ITERATIONS)
        correlation = 1.0 if refined is None else max(0.0, refined.correlation)
        if refined is not None and refined.correlation < MIN_CORRELATION and sight is not None:
            # The landmarks still see a face where the texture does not know it.
            start, refined = sight.face, None
        elif is_tracking_failure(looks and sight is None, tracks, refined):
            return self._miss(last)
        found = self._correct(caller, start, refined)
        if not is_plausible(found, caller.fitted):
            return self._miss(last)
        if refined is not None:
            for texture in caller.textures:
                texture.update_template(grey, refined)
            if self._refinement is not None:
                self._refinement.advance(self._elapsed_s)
                if refined.correlation > GOOD_CORRELATION:
                    self._refinement.add_keyframe_candidate(grey, found)
        caller.klt.reset_points(grey, camera, found)
        self.confidence = correlation
        self._last, self._bad = found, 0
        return found

    def _measured_by_network(self) -> bool:
        return self._has("network") and self._sighter.point_count > 0

    def _predict(self, last: FaceParameters) -> FaceParameters:
        if self._filter is None or not self._has("ekf"):
            return last
        return self._face_of(self._filter.predict(self._elapsed_s), last)

    def _face_of(self, estimate: Estimate, like: FaceParameters) -> FaceParameters:
        eau = like.eau.copy()
        eau[self._active] = estimate.eau
        return replace(like, pose=estimate.pose, eau=clip_eau(eau))

    def _fuse(
        self,
        caller: TrackedPerson,
        predicted: FaceParameters,
        sight: FrameMeasurement | None,
        tracks: Tracks | None,
    ) -> FaceParameters:
        """Where landmarks and KLT points have the face."""
        if self._filter is not None and self._has("ekf"):
            estimate = self._measure(caller, tracks, sight, None, predicted)
            return self._face_of(estimate, predicted)
        if sight is not None:
            return sight.face
        if tracks is None:
            return predicted
        ok = np.isfinite(tracks.variance_px2)
        if ok.sum() < 6:
            return predicted
        points, pixels = tracks.points_mm[ok], tracks.pixels[ok]
        pose = pose_from_points(caller.fitted.camera, points, pixels, predicted.pose)
        return replace(predicted, pose=pose)

    def _refine(
        self,
        caller: TrackedPerson,
        grey: Picture,
        starts: Sequence[FaceParameters],
        iterations: Sequence[int],
    ) -> TextureFit:
        """Fit the textured model, coarse to fine; only the best start goes on to be fitted fine."""
        for texture, count in zip(caller.textures, iterations, strict=True):
            view = texture.observe(grey, starts[0])
            best = texture.fit(view, starts[0], self._active, count)
            if self._number % OTHER_STARTS_EVERY == 0 or best.correlation < GOOD_CORRELATION:
                rest = [texture.fit(view, face, self._active, count) for face in starts[1:]]
                other = max(rest, key=lambda r: r.correlation, default=best)
                if other.correlation > best.correlation + CLEARLY_BETTER:
                    best = other
            if texture is caller.textures[0] and self._number % ACROSS_EVERY == 0:
                best = self._across_rest(texture, view, best, count)
            texture.update_noise_level(best)
            starts = [best.face]
        return best

    def _across_rest(
        self, texture: PersonTexture, view: Observation, best: TextureFit, iterations: int
    ) -> TextureFit:
        """The better of a fit and, where that halts near rest, one from the other side."""
        if CORNERS not in self._active or abs(best.face.eau[CORNERS]) > NEAR_REST:
            return best
        other = texture.fit(view, opposite_start(best.face), self._active, iterations)
        return (
            other
            if other.residual_mse_grey2 < (1 - MIN_IMPROVEMENT) * best.residual_mse_grey2
            else best
        )

    def _starts(
        self, start: FaceParameters, sight: FrameMeasurement | None
    ) -> list[FaceParameters]:
        """Where the fit may start: an expression lost sight of is found by its landmarks."""
        if sight is None:
            return [start]
        return [start, replace(start, eau=sight.face.eau), sight.face]

    def _correct(
        self, caller: TrackedPerson, start: FaceParameters, refined: TextureFit | None
    ) -> FaceParameters:
        """What the fit of the textured model has to say, filtered."""
        if refined is None:
            return start
        if self._filter is None or not self._has("ekf"):
            return refined.face
        return self._face_of(self._measure(caller, None, None, refined, start), start)

    def _measure(
        self,
        caller: TrackedPerson,
        tracks: Tracks | None,
        sight: FrameMeasurement | None,
        fit: TextureFit | None,
        like: FaceParameters,
    ) -> Estimate:
        """Update the filter by what there is; the rest has infinite variance."""
        assert self._filter is not None
        n, m, k = len(caller.klt.index), self._sighter.point_count, len(caller.anchors)
        points, pixels = np.zeros((n + m + k, 3)), np.zeros((n + m + k, 2))
        variance = np.full(n + m + k, np.inf)
        eau, eau_variance = like.eau[self._active], np.full(len(self._active), np.inf)
        if tracks is not None:
            points[:n], pixels[:n], variance[:n] = (
                tracks.points_mm,
                tracks.pixels,
                tracks.variance_px2,
            )
        if sight is not None:
            at = slice(n, n + m)
            # By the angle they claim: a filter that is wrongly turned aside would doubt them all.
            wider = (1 + (_aside_deg(sight.face.pose) / NETWORK_WIDE_DEG) ** 2) ** 2
            points[at], pixels[at] = sight.points_mm, sight.pixels
            variance[at] = wider * sight.variance_px2
            eau, eau_variance[:] = sight.face.eau[self._active], wider * NETWORK_EAU_SIGMA**2
        if fit is not None:
            refined = fit.face
            camera = caller.fitted.camera
            eyes_px = eye_distance_px(camera, refined.pose)
            points[n + m :] = caller.face.animate(refined.eau)[caller.anchors]
            pixels[n + m :] = pixel_from_head(camera, refined.pose, points[n + m :])
            variance[n + m :] = (ABS_SIGMA * eyes_px) ** 2
            eau = refined.eau[self._active]
            clear = (
                np.clip(fit.residual_sigma_grey, MIN_RESIDUAL_SIGMA_GREY, RESIDUAL_SIGMA_GREY)
                / RESIDUAL_SIGMA_GREY
            )
            # The texture knows nothing of closed lids: the network sees them at least as well.
            sharper = np.where(np.isin(self._active, LIDS), 1.0, clear)
            eau_variance[:] = (sharper * ABS_EAU_SIGMA) ** 2
        return self._filter.update(points, pixels, variance, eau, eau_variance)

    def _miss(self, last: FaceParameters) -> FaceParameters | None:
        """Hold the last face for a few frames, then give it up."""
        self._bad += 1
        self.confidence = 0.0
        if self._bad < LOST_AFTER_FRAMES:
            return last
        self._last = None
        return None

    def _recover(self, caller: TrackedPerson, frame: Picture) -> FaceParameters | None:
        """Look for the same caller anywhere in the picture."""
        sight = self._sighter.measure(frame, None)
        if sight is None or not is_plausible(sight.face, caller.fitted):
            return None
        found, grey, correlation = sight.face, luma_u8(frame), 1.0
        if self._has("abs"):
            refined = self._refine(caller, grey, [found], RECOVERY_ITERATIONS)
            correlation = max(0.0, refined.correlation)
            if refined.correlation >= MIN_CORRELATION_RECOVERED:
                found = refined.face
            elif not self._measured_by_network():
                return None
        caller.klt.reset_points(grey, caller.fitted.camera, found)
        self._restart(caller, found)
        self.confidence = correlation
        return found


def opposite_start(face: FaceParameters) -> FaceParameters:
    """The face with the mouth's corners on the other side of rest."""
    corners = np.arange(len(face.eau)) == CORNERS
    side = -ACROSS if face.eau[CORNERS] >= 0 else ACROSS
    return replace(face, eau=np.where(corners, side, face.eau))


def _aside_deg(pose: Pose) -> float:
    """Degrees between where the face looks and the camera."""
    towards = -pose.translation_mm / np.linalg.norm(pose.translation_mm)
    ahead = matrix_from_quaternion(pose.rotation)[:, 2]
    return float(np.degrees(np.arccos(np.clip(ahead @ towards, -1, 1))))
