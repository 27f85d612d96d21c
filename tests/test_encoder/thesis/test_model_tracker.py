"""The model tracker on a rendered person with known parameters: accuracy, parts left out, recovery
after the face was lost, and rejection of implausible faces."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from decoder.rendering.renderer import Renderer
from encoder.fitting.fit_results import IdentityFit
from encoder.thesis.detection_measurement import FrameMeasurement
from encoder.thesis.klt import eye_distance_px
from encoder.thesis.model_tracker import LOST_AFTER_FRAMES, ModelTracker
from encoder.thesis.tracking_options import TRACKER_PARTS, TrackingOptions
from risorius.animation.synthetic_skin import painted_colours
from shared_model.animate import Face, identity_from_controls
from shared_model.geometry import Camera, euler_deg, pixel_from_head, pose_from_euler
from shared_model.mesh import generic_head
from shared_model.parameters import AAUS, EAU_INDEX, EAUS, THESIS_EAUS, FaceParameters
from shared_model.shape_residual import control_points, residual_basis

HEAD = generic_head()
CAMERA = Camera(256, 224, 360.0)
ACTIVE = [EAU_INDEX[name] for name in THESIS_EAUS]
STEP_S = float(Fraction(1, 25))
CONTROL = np.zeros((len(residual_basis(HEAD)), 3))
IDENTITY = identity_from_controls(HEAD, np.zeros(len(AAUS)), CONTROL)
FACE = Face(HEAD, IDENTITY)
Picture = np.ndarray
ALL_PARTS = TrackingOptions()


def face_at(step: int) -> FaceParameters:
    """Turns, tilts, opens and closes the mouth; straight and at rest at step 0."""
    t = step * STEP_S
    eau = np.zeros(len(EAUS))
    eau[EAU_INDEX["jaw_drop"]] = 0.5 * np.sin(np.pi * t / 0.9) ** 2
    eau[EAU_INDEX["mouth_corners"]] = 0.5 * np.sin(2 * np.pi * t / 1.3)
    place = np.array([12 * np.sin(3 * t), 6 * np.sin(4 * t), 520 + 25 * np.sin(2 * t)])
    pose = pose_from_euler(8 * np.sin(4 * t), 20 * np.sin(3.3 * t), 9 * np.sin(2.7 * t), place)
    return FaceParameters(pose, eau)


@pytest.fixture(scope="module")
def film() -> list[Picture]:
    """36 pictures of `face_at`, with noise and a light that goes up and down."""
    renderer = Renderer(CAMERA.width, CAMERA.height, HEAD, samples=4)
    colours, random = painted_colours(HEAD, mottle=0.15, seed=3), np.random.default_rng(5)
    frames = []
    for step in range(36):
        face = face_at(step)
        drawn = renderer.draw_shaded(CAMERA, face.pose, FACE.animate(face.eau), colours)
        light = 1 + 0.1 * np.sin(step / 5)
        noisy = light * drawn.astype(np.float64) + random.normal(0, 2, drawn.shape)
        frames.append(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
    renderer.close()
    return frames


class TruthMeasurer:
    """A `FrameMeasurer` that measures the truth with an error of `error_px`, except where blind."""

    def __init__(
        self, error_px: float = 0.5, points: int = 30, blind: frozenset[int] = frozenset()
    ):
        self.point_count, self.step, self._blind = points, -1, blind
        self._error_px, self._random = error_px, np.random.default_rng(1)
        skin = np.flatnonzero((HEAD.parts == 0) & (HEAD.opacity > 0.9))
        self._index = skin[:: len(skin) // max(points, 1)][:points]
        self.false_face: FaceParameters | None = None

    def initialise(self, frame: Picture) -> IdentityFit | None:
        return (
            None
            if self.step in self._blind
            else IdentityFit(CAMERA, IDENTITY, CONTROL, (self.face,))
        )

    def measure(
        self, frame: Picture, predicted: FaceParameters | None, next_frame: Picture | None = None
    ) -> FrameMeasurement | None:
        if self.step in self._blind:
            return None
        face = self.false_face or self.face
        points = FACE.animate(face.eau)[self._index]
        pixels = pixel_from_head(CAMERA, face.pose, points)
        pixels = pixels + self._random.normal(0, self._error_px, pixels.shape)
        return FrameMeasurement(face, points, pixels, np.full(len(points), self._error_px**2))

    def set_identity(self, fitted: IdentityFit) -> None:
        self.identity = fitted

    @property
    def face(self) -> FaceParameters:
        return face_at(self.step)


def track_film(
    film: list[Picture],
    measurer: TruthMeasurer,
    options: TrackingOptions = ALL_PARTS,
) -> list[FaceParameters | None]:
    tracker = ModelTracker(HEAD, ACTIVE, STEP_S, measurer, options)
    found = []
    for step, frame in enumerate(film):
        measurer.step = step
        found.append(tracker.update(frame))
    return found


def without(*parts: str) -> TrackingOptions:
    return TrackingOptions(without=frozenset(parts))


def degrees_off(found: list[FaceParameters | None], first: int = 0) -> float:
    """Root mean square error of the three angles from step `first` on."""
    pairs = [(f, face_at(i)) for i, f in enumerate(found) if f is not None and i >= first]
    off = np.array([np.subtract(euler_deg(f.pose), euler_deg(t.pose)) for f, t in pairs])
    return float(np.sqrt(np.mean(off**2)))


def actuators_off(found: list[FaceParameters | None]) -> float:
    off = [f.eau[ACTIVE[:2]] - face_at(i).eau[ACTIVE[:2]] for i, f in enumerate(found) if f]
    return float(np.sqrt(np.mean(np.square(off))))


def test_pose_and_mouth_are_tracked_without_landmarks(film: list[Picture]) -> None:
    found = track_film(film, TruthMeasurer(), without("network"))
    assert None not in found
    assert degrees_off(found) < 1.0
    assert actuators_off(found) < 0.08


def test_points_wherever_they_become_visible_track_as_well(film: list[Picture]) -> None:
    options = replace(without("network"), klt_points="visible")
    found = track_film(film, TruthMeasurer(), options)
    assert None not in found
    assert degrees_off(found) < 1.0


@pytest.mark.parametrize("part", sorted(set(TRACKER_PARTS) - {"abs", "network"}))
def test_any_part_can_be_left_out(film: list[Picture], part: str) -> None:
    """Tests beside this one track without `abs` and without `network`."""
    found = track_film(film, TruthMeasurer(), without(part))
    assert None not in found
    assert degrees_off(found) < 2.0


def test_prediction_matrices_track_pose_and_mouth(film: list[Picture]) -> None:
    options = replace(without("network"), step="matrix")
    found = track_film(film, TruthMeasurer(), options)
    assert None not in found
    assert degrees_off(found) < 2.0
    assert actuators_off(found) < 0.1


@pytest.mark.parametrize("projection", ["perspective", "lowe"])
@pytest.mark.parametrize("free_focal", [False, True])
def test_faces_have_the_focal_length_of_the_identity_whatever_the_filter_estimates(
    film: list[Picture], projection: str, free_focal: bool
) -> None:
    options = replace(without("abs"), projection=projection, free_focal=free_focal)
    found = track_film(film, TruthMeasurer(), options)
    assert degrees_off(found) < 1.5
    for step, face in enumerate(found):
        assert face is not None
        points = FACE.animate(face.eau)[::97]
        truth = pixel_from_head(CAMERA, face_at(step).pose, points)
        error_px = pixel_from_head(CAMERA, face.pose, points) - truth
        assert np.sqrt(np.mean(error_px**2)) < 2


def test_the_fit_of_the_texture_corrects_noisy_landmarks(film: list[Picture]) -> None:
    alone = degrees_off(track_film(film, TruthMeasurer(4.0), without("abs", "klt")))
    assert degrees_off(track_film(film, TruthMeasurer(4.0))) < 0.5 * alone


# Noise by which the correlation of the texture falls to .87.
@pytest.mark.parametrize(
    ("noise_grey", "aside_deg", "left_out"), [(0, 15, ()), (25, 20, ("klt",))], ids=str
)
def test_landmarks_turned_alike_do_not_turn_a_face_that_the_texture_explains(
    film: list[Picture], noise_grey: float, aside_deg: float, left_out: tuple[str, ...]
) -> None:
    measurer, random = TruthMeasurer(), np.random.default_rng(2)
    tracker = ModelTracker(HEAD, ACTIVE, STEP_S, measurer, without(*left_out))
    for step, clean in enumerate(film[:16]):
        measurer.step = step
        noise = random.normal(0, noise_grey, clean.shape) if step else 0
        true = face_at(step)
        pitch, yaw, roll = euler_deg(true.pose)
        aside = pose_from_euler(pitch, yaw + aside_deg, roll, true.pose.translation_mm)
        measurer.false_face = replace(true, pose=aside) if step else None
        found = tracker.update(np.clip(clean + noise, 0, 255).astype(np.uint8))
        assert found is not None
        assert np.linalg.norm(np.subtract(euler_deg(found.pose), euler_deg(true.pose))) < 1.5


def test_a_face_that_leaves_is_lost_and_recovered(film: list[Picture]) -> None:
    gone = frozenset(range(12, 22))
    empty = np.full_like(film[0], 90)
    seen = [empty if step in gone else frame for step, frame in enumerate(film)]
    found = track_film(seen, TruthMeasurer(blind=gone))
    assert [f is None for f in found[12 : 12 + LOST_AFTER_FRAMES]] == [False, False, True]
    assert found[15:22] == [None] * 7
    assert None not in found[22:]
    assert degrees_off(found, 22) < 1.0


def test_the_last_face_is_repeated_before_the_face_is_lost(film: list[Picture]) -> None:
    empty = np.full_like(film[0], 90)
    seen = [*film[:10], *[empty] * (LOST_AFTER_FRAMES - 1), *film[12:16]]
    found = track_film(seen, TruthMeasurer(blind=frozenset({10, 11})))
    assert found[10] is found[9] and found[11] is found[9]
    assert None not in found


def test_an_implausible_measurement_is_rejected(film: list[Picture]) -> None:
    measurer = TruthMeasurer()
    tracker = ModelTracker(HEAD, ACTIVE, STEP_S, measurer, ALL_PARTS)
    for step, frame in enumerate(film[:12]):
        measurer.step = step
        if step >= 6:
            pose = measurer.face.pose
            behind = replace(pose, translation_mm=pose.translation_mm * [1, 1, -1])
            measurer.false_face = replace(measurer.face, pose=behind)
        found = tracker.update(frame)
        assert found is not None
        assert np.linalg.norm(np.subtract(euler_deg(found.pose), euler_deg(face_at(step).pose))) < 3


def test_landmarks_of_a_turned_face_have_little_weight(film: list[Picture]) -> None:
    measurer = TruthMeasurer()
    tracker = ModelTracker(HEAD, ACTIVE, STEP_S, measurer, without("abs"))
    for step, frame in enumerate(film[:10]):
        measurer.step = step
        aside = pose_from_euler(0, 60, 0, measurer.face.pose.translation_mm)
        measurer.false_face = replace(measurer.face, pose=aside) if step else None
        found = tracker.update(frame)
        assert found is not None
        assert np.linalg.norm(np.subtract(euler_deg(found.pose), euler_deg(face_at(step).pose))) < 6


def test_there_is_no_identity_before_the_first_face(film: list[Picture]) -> None:
    measurer = TruthMeasurer(blind=frozenset({0}))
    tracker = ModelTracker(HEAD, ACTIVE, STEP_S, measurer, ALL_PARTS)
    measurer.step = 0
    assert tracker.update(film[0]) is None
    with pytest.raises(ValueError, match="no face has been seen"):
        _ = tracker.fitted
    measurer.step = 1
    assert tracker.update(film[1]) is not None
    assert tracker.fitted.camera == CAMERA


class UncertainMeasurer(TruthMeasurer):
    """Starts with the identity of a longer nose, and states its information."""

    def initialise(self, frame: Picture) -> IdentityFit | None:
        control = CONTROL.copy()
        points = HEAD.vertices[control_points(HEAD)]
        nearest = np.linalg.norm(points - HEAD.vertices[HEAD.landmarks["prn"]], axis=1).argmin()
        control[nearest, 2] = 8.0
        identity = identity_from_controls(HEAD, np.zeros(len(AAUS)), control)
        # Log f, AAUs, controls, turn, way, actuators.
        sure = [1e4] + [4.0] * len(AAUS) + [0.1] * control.size + [1e4] * 3 + [1.0] * 3
        information = np.diag(np.array([*sure, *[1e4] * len(EAUS)]))
        return IdentityFit(CAMERA, identity, control, (self.face,), information)


@pytest.mark.parametrize("step", ["gauss-newton", "matrix"])
def test_a_refined_identity_is_adopted_and_tracking_goes_on(film: list[Picture], step: str) -> None:
    measurer = UncertainMeasurer()
    tracker = ModelTracker(
        HEAD,
        ACTIVE,
        4 * STEP_S,
        measurer,
        TrackingOptions(step=step),
    )
    found, adopted = [], None
    for number, frame in enumerate(film):
        measurer.step = number
        found.append(tracker.update(frame))
        better = tracker.take_refined_identity()
        if better is not None:
            before, adopted = tracker.fitted, number
            tracker.adopt(better)
            assert tracker.fitted is better and measurer.identity is better
    assert adopted is not None and adopted < len(film) - 5
    assert np.abs(tracker.fitted.control_mm - before.control_mm).max() > 0.1
    assert None not in found
    assert degrees_off(found, adopted + 1) < 1.5


def test_the_identity_is_refined_only_on_request_and_with_information(
    film: list[Picture],
) -> None:
    for measurer, options in (
        (TruthMeasurer(), ALL_PARTS),
        (UncertainMeasurer(), without("abs")),
        (UncertainMeasurer(), TrackingOptions(refine_identity=False)),
    ):
        tracker = ModelTracker(HEAD, ACTIVE, 4 * STEP_S, measurer, options)
        for number, frame in enumerate(film):
            measurer.step = number
            tracker.update(frame)
            assert tracker.take_refined_identity() is None
        with pytest.raises(ValueError, match="no identity is refined"):
            tracker.adopt(tracker.fitted)


def test_the_identity_of_a_small_face_is_not_refined(
    film: list[Picture], monkeypatch: pytest.MonkeyPatch
) -> None:
    smaller = eye_distance_px(CAMERA, UncertainMeasurer().face.pose) + 1
    monkeypatch.setattr("encoder.thesis.model_tracker.MIN_EYE_DISTANCE_PX", smaller)
    measurer = UncertainMeasurer()
    tracker = ModelTracker(HEAD, ACTIVE, 4 * STEP_S, measurer, ALL_PARTS)
    for number, frame in enumerate(film):
        measurer.step = number
        tracker.update(frame)
        assert tracker.take_refined_identity() is None
