"""One person's part of a recorded call: its frames are seen twice, then the whole part is coded.

First pass: landmarks of every frame.  Between the passes: one identity and one appearance model.
Second pass: the face in every frame that is coded, fitted with that model.
"""

import logging
from collections import deque
from collections.abc import Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from itertools import takewhile

import numpy as np

from encoder.calls.session_stats import SessionStats
from encoder.capture.face_crop import Crop, crop_face
from encoder.capture.video_source import Capture
from encoder.coding.background import Background, BackgroundImage
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import ModelBudget, build_model_packet, call_parameters
from encoder.coding.progressive_model import LayeredModel, split_into_layers
from encoder.coding.rate_control import RateTarget, code_call, packet_bits
from encoder.coding.transform import transform_call
from encoder.detection.landmark_indices import face_outline
from encoder.fitting.quantised_identity import quantised_identity
from encoder.fitting.render_and_compare import ImageFitter
from encoder.fitting.sequence_fit import fit_sequence, smooth_landmarks
from encoder.layers.layer_learning import layers_of_person
from encoder.layers.layer_model import LayerModel
from encoder.layers.layer_samples import FittedFrames, coarse_picture, typical_frame
from encoder.learning.absence import AbsenceWatch
from encoder.learning.frame_sampler import DENSE_FRAMES, UniformSubsampler
from encoder.learning.hidden_faces import HandWatch, SampleHands, without_hands
from encoder.learning.person_model import PersonModelOptions, TrainedModel, build_person_model
from encoder.residual.residual_encoder import has_residual
from protocol.call_parameters import CallParameters
from protocol.model_packet import ModelPacket
from runtime.parallel import worker_pool
from shared_model.animate import Face
from shared_model.arrays import Array, Picture
from shared_model.parameters import FaceParameters
from shared_model.surround import head_with_surround

_log = logging.getLogger(__name__)


# Frames of the second pass whose fits are under way or done when the next frame is read.
MAX_IN_FLIGHT = 32


@dataclass(frozen=True, slots=True)
class EncodedCall:
    """A whole call, or one person's part of one.

    model: the model packet that is sent first.
    layers: what is sent of the model between frame packets; None: nothing.
    payloads: of the frame packets.
    frames: number of source frames.  lost: those without a face.  empty: those without anybody, if
        it is known what is behind the person.
    last_face: source frame of the last coded face.
    """

    model: ModelPacket
    payloads: tuple[bytes, ...]
    frames: int
    lost: frozenset[int]
    empty: frozenset[int] = frozenset()
    layers: LayeredModel | None = None
    last_face: int = 0


@dataclass(frozen=True, slots=True)
class _CallModel:
    """What is known of the call between the passes.

    detections: of each frame to be coded, the index of the detection whose face it has.
    initial: the face of each detection, by its landmarks.
    background, layers: what is behind the face; None: one picture.
    hands: what hides the face.
    """

    call: CallParameters
    budget: ModelBudget
    trained: TrainedModel
    image_fitter: ImageFitter
    detections: list[int]
    initial: list[FaceParameters]
    background: Background
    layers: LayerModel | None
    hands: SampleHands


class TwoPassEncoder:
    """Encodes the frames of one person, in a source that can be read twice.

    Call `take` or `miss` with every frame, `build_model`, `fit_frames` with every frame again, then
    `encode` at one bitrate or several.
    """

    def __init__(self, capture: Capture, stats: SessionStats, gop: GopStructure) -> None:
        self._capture, self._stats, self._gop = capture, stats, gop
        self._points: list[Array] = []  # landmarks of each detection
        self._detection_of: dict[int, int] = {}  # by source frame
        self._frames = 0
        self._sampler = UniformSubsampler[Picture](dense_frames=DENSE_FRAMES)
        self._absence = AbsenceWatch()
        self._model: _CallModel | None = None
        self._faces: dict[int, FaceParameters] = {}  # by detection

    @property
    def started(self) -> bool:
        """Whether the first pass has found a face yet."""
        return bool(self._points)

    @property
    def faces_fitted(self) -> int:
        """Number of faces that `fit_frames` has fitted."""
        return len(self._faces)

    @property
    def first_face(self) -> int:
        """Source frame of the first face."""
        return min(self._detection_of)

    def take(self, index: int, picture: Picture, points: Array) -> None:
        """First pass: source frame `index` has a face with these landmarks (468, 3), pixels."""
        self._frames = index + 1
        self._detection_of[index] = len(self._points)
        self._sampler.offer(len(self._points), lambda: picture)
        self._points.append(points)

    def miss(self, index: int, picture: Picture) -> None:
        """First pass: source frame `index` has no face."""
        self._frames = index + 1
        self._absence.take(index, picture)

    def build_model(self, budget: ModelBudget) -> None:
        """Between the passes: identity and appearance of the person."""
        head = head_with_surround()
        size = (self._capture.width, self._capture.height)
        with self._stats.stage("identity"):
            points = list(smooth_landmarks(np.array(self._points)))
            identity, initial = fit_sequence(head, size, points, workers=None)
        start, gop = min(self._detection_of), self._gop
        held = hold_last_detection(self._detection_of, start, max(self._detection_of) + 1)
        packing = (gop.frames_per_packet, gop.frame_step)
        focal_px = identity.camera.focal_px
        call = call_parameters(self._capture.format, "default", focal_px, start, *packing)
        sampled, pictures = zip(*self._sampler.frames, strict=True)
        with self._stats.stage("hands"):
            watch = HandWatch()
            hands = watch.find_all(pictures, [self._points[number] for number in sampled])
        shown = without_hands(hands)
        _log.info("%d of %d sampled frames show a hand", len(hands) - len(shown), len(hands))
        canonical = shown[typical_frame([initial[sampled[number]] for number in shown])]
        sizes = budget.texture_size, budget.appearance_bytes, budget.max_modes
        options = PersonModelOptions(*sizes, reference=sampled[canonical])
        with self._stats.stage("train"):
            trained = build_person_model(
                identity,
                Face(head, quantised_identity(head, identity)),
                call.camera,
                initial,
                self._sampler.frames,
                self._points,
                options,
                hands=hands,
            )
        background, layers = self._learn_layers(trained, call, shown, canonical)
        fitter, detections = trained.person.image_fitter(), held[:: gop.frame_step]
        self._model = _CallModel(
            call,
            budget,
            trained,
            fitter,
            detections,
            initial,
            background,
            layers,
            SampleHands(watch, sampled, hands),
        )

    def _learn_layers(
        self, trained: TrainedModel, call: CallParameters, shown: list[int], canonical: int
    ) -> tuple[Background, LayerModel | None]:
        """What is behind the face.

        shown: numbers in the sample of the frames without hands.  canonical: of the typical one.
        """
        numbers, pictures = zip(*(self._sampler.frames[i] for i in shown), strict=True)
        outlines = [face_outline(self._points[number]) for number in numbers]
        person, empty = trained.person, self._absence.pictures
        faces, canonical = [trained.faces[i] for i in shown], shown.index(canonical)
        sample = pictures, faces, outlines, canonical, person.reference, empty
        with self._stats.stage("layers"):
            layers, reason = layers_of_person(FittedFrames(person.face, call.camera, *sample))
        if layers is None:
            self._stats.warn(reason)
            return BackgroundImage(pictures[canonical]), None
        return layers, layers

    def fit_frames(self, frames: Iterable[tuple[int, Picture]]) -> None:
        """Second pass over source frames (index, picture): fit the face in those to be coded.

        Frames are read while those before them are fitted.
        """
        model = self._model
        assert model is not None
        person, needed = model.trained.person, frozenset(model.detections)

        def fit(detection: int, crop: Crop, picture: Picture) -> FaceParameters:
            outline = face_outline(self._points[detection])
            face = person.fit_texels(crop, model.initial[detection])
            face = model.image_fitter.fit(crop, face, outline)
            if model.layers is None:
                return face
            return model.layers.frames.fitted(picture, face, outline)

        in_flight = deque[tuple[int, Future[FaceParameters]]]()
        with worker_pool() as pool:
            for index, picture in frames:
                detection = self._detection_of.get(index)
                if detection is None or detection not in needed:
                    continue
                if len(in_flight) == MAX_IN_FLIGHT:
                    self._collect(*in_flight.popleft())
                points = self._points[detection]
                with self._stats.stage("crop"):
                    crop = crop_face(picture, points, person.pixels_per_texel)
                    crop = crop.hiding(model.hands.in_frame(detection, picture, points))
                in_flight.append(
                    (detection, pool.submit(fit, detection, crop, coarse_picture(picture)))
                )
            for each in in_flight:
                self._collect(*each)

    def _collect(self, detection: int, fit: Future[FaceParameters]) -> None:
        with self._stats.stage("fit"):
            self._faces[detection] = fit.result()

    def encode(self, bitrate: float, progressive: bool = False) -> EncodedCall:
        """The call at `bitrate` bits per second, all frame packets counted.

        progressive: the model is split into layers.
        """
        model = self._model
        assert model is not None
        start, gop = model.call.start_frame, self._gop
        detections = list(takewhile(self._faces.__contains__, model.detections))
        stopped_at = start + (len(detections) - 1) * gop.frame_step + 1
        frames = self._frames if len(detections) == len(model.detections) else stopped_at
        row = {detection: i for i, detection in enumerate(self._faces)}
        with self._stats.stage("transform"):
            faces = list(self._faces.values())
            distortion = None if model.layers is None else model.layers.distortion
            transform, values = transform_call(
                model.trained, faces, gop.frames_per_packet, distortion
            )
            background = model.background.encode(model.budget.background_bytes)
            packet = build_model_packet(model.trained.person, transform, model.call, background)
        coded = values[[row[detection] for detection in detections]]
        payloads = code_payloads(
            coded, transform.scale_codes, bitrate, gop, self._capture, self._stats
        )
        lost = frozenset(set(range(start, frames)) - set(self._detection_of))
        empty = lost & self._absence.empty if model.layers is not None else frozenset[int]()
        if not progressive:
            return EncodedCall(packet, payloads, frames, lost, empty, last_face=stopped_at - 1)
        layers = split_into_layers(packet, model.trained.person.appearance.mean, model.background)
        base = layers.base
        return EncodedCall(base, payloads, frames, lost, empty, layers, stopped_at - 1)

    def may_have_residual(self, bitrate: float) -> bool:
        """See `RecordedEncoder`."""
        assert self._model is not None
        call = self._model.call
        frames = call.frames_per_packet * call.frame_step
        return has_residual(bitrate, (call.width, call.height), frames)


def code_payloads(
    values: Array,
    scale_codes: Picture,
    bitrate: float,
    gop: GopStructure,
    capture: Capture,
    stats: SessionStats,
) -> tuple[bytes, ...]:
    """Payloads of the frame packets at `bitrate`, from the components (t, n) of the coded frames.

    Adds a warning if the rate is too little.
    """
    target = RateTarget(bitrate, float(gop.coded_fps(capture.fps)), gop.frames_per_packet)
    with stats.stage("code"):
        packets = code_call(values, scale_codes, target)
    excess = target.overshoot_message(sum(map(packet_bits, packets)), len(values))
    if excess is not None and not target.is_brief(len(values)):
        stats.warn(excess)
    return tuple(packet.payload for packet in packets)


def hold_last_detection(detection_of: dict[int, int], start: int, end: int) -> list[int]:
    """For each source frame from `start` to `end`, the newest detection until then."""
    held, last = [], detection_of[start]
    for index in range(start, end):
        last = detection_of.get(index, last)
        held.append(last)
    return held
