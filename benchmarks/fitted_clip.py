"""The parameters of a clip as the two-pass encoder codes them, fitted in the shape-free frame."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from encoder.capture.face_crop import crop_face
from encoder.capture.video_source import Capture, open_source
from encoder.coding.distortion import measure_distortion
from encoder.coding.gop import FRAMES_PER_PACKET
from encoder.coding.model_packet import BUDGETS
from encoder.coding.transform import design_transform, project
from encoder.detection.blazeface import BlazeFaceDetector
from encoder.detection.landmarks import LandmarkTracker
from encoder.detection.tflite import find_network_folder
from encoder.fitting.quantised_identity import quantised_identity
from encoder.fitting.sequence_fit import fit_sequence, smooth_landmarks
from encoder.learning.frame_sampler import UniformSubsampler
from encoder.learning.person_model import PersonModelOptions, build_person_model
from protocol.call_parameters import CallParameters
from protocol.frames.frame_transform import FrameTransform, vector_from_face
from shared_model.animate import Face
from shared_model.arrays import Array, Picture
from shared_model.parameters import FaceParameters
from shared_model.surround import head_with_surround


@dataclass(frozen=True, slots=True)
class FittedClip:
    """The parameters y (t, d) of each frame, and component values (t, n) by their transform.

    distortion_matrix: (d, d), see `DistortionModel`.
    """

    vectors: Array
    distortion_matrix: Array
    transform: FrameTransform
    values: Array
    fps: float

    def distortion_of(self, decoded: Array) -> float:
        """Mean distortion of decoded parameters (t, d), grey levels squared."""
        error = self.vectors - decoded
        return float(np.einsum("td,de,te->t", error, self.distortion_matrix, error).mean())

    def distortion_of_values(self, values: Array) -> float:
        """Mean distortion of decoded component values (t, n)."""
        return self.distortion_of(self.transform.mean + values @ self.transform.matrix)


def fit_clip(source: str) -> FittedClip:
    """The parameters of a clip, fitted in the shape-free frame by a model of the whole clip."""
    head, sampler = head_with_surround(), UniformSubsampler[Picture]()
    landmarks: list[Array] = []
    with open_source(source) as capture:
        size, fps = (capture.width, capture.height), capture.fps
        for frame, points in frames_with_face(capture):
            sampler.offer(len(landmarks), frame.copy)
            landmarks.append(points)
    fitted, initial = fit_sequence(head, size, list(smooth_landmarks(np.array(landmarks))))
    call = CallParameters("default", *size, fps.numerator, fps.denominator, fitted.camera.focal_px)
    budget = BUDGETS["default"]
    trained = build_person_model(
        fitted,
        Face(head, quantised_identity(head, fitted)),
        call.camera,
        initial,
        sampler.frames,
        landmarks,
        PersonModelOptions(budget.texture_size, budget.appearance_bytes, budget.max_modes),
    )
    person, faces = trained.person, list[FaceParameters]()
    with open_source(source) as capture:
        for (frame, _), points, start in zip(
            frames_with_face(capture), landmarks, initial, strict=True
        ):
            crop = crop_face(frame, points, person.pixels_per_texel)
            faces.append(person.fit_texels(crop, start))
    pose = person.reference.pose
    model = measure_distortion(person.texel_fitter, trained.crops[::8], trained.faces[::8], pose)
    distortion = model.distortion_matrix(person.texel_fitter.template.modes)
    vectors = np.array([vector_from_face(face, pose) for face in faces])
    modes = person.appearance.modes
    transform = design_transform(vectors, distortion, modes, FRAMES_PER_PACKET)
    values = project(transform, vectors, distortion)
    return FittedClip(vectors, distortion, transform, values, float(fps))


def frames_with_face(capture: Capture) -> Iterator[tuple[Picture, Array]]:
    """The frames of a source that show a face, with landmarks (468, 3), pixels."""
    folder = find_network_folder()
    tracker = LandmarkTracker(folder, BlazeFaceDetector(folder), refine_eyelids=False)
    for _, frame in capture:
        if (found := tracker.update(frame)) is not None:
            yield frame, found.points
