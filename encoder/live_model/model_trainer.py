"""Trains the versions of a live call's model, each from more frames than the one before."""

from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import replace
from typing import Any

import numpy as np

from encoder.capture.video_source import VideoFormat
from encoder.coding.background import (
    BackgroundImage,
    EncodeBackground,
    background_in_light,
    encoded_in_a_thread,
)
from encoder.coding.distortion import distortion_of
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import ModelBudget, build_model_packet, call_parameters
from encoder.coding.motion_prior import transform_from_prior
from encoder.coding.progressive_model import (
    BASE_LAYER_BYTES,
    UPDATE_BASE_LAYER_BYTES,
    split_into_layers,
)
from encoder.detection.landmark_indices import face_outline
from encoder.fitting.eyelids import fit_with_eyelids
from encoder.fitting.fit_results import IdentityFit
from encoder.fitting.landmark_fit import LandmarkModel, landmark_model, personalise
from encoder.fitting.quantised_identity import quantised_identity
from encoder.fitting.sequence_fit import fit_sequence
from encoder.layers.frame_layers import FrameLayers
from encoder.layers.layer_learning import FirstLayers, layers_of_person
from encoder.layers.layer_samples import FittedFrames
from encoder.learning.hidden_faces import (
    HandWatch,
    Outlines,
    that_come_and_go,
    without_hands,
)
from encoder.learning.person_model import PersonModelOptions, TrainedModel, build_person_model
from encoder.live_model.model_version import RESERVED_MODES, ModelVersion, live_distortion
from encoder.live_model.pacing import LAYER_UPDATES
from protocol.call_parameters import CallParameters
from protocol.frames.frame_transform import vector_from_face, with_reserved_modes
from protocol.frames.transform_coding import serialise_transform
from protocol.pictures.picture_codec import ModeCodec, decode_picture
from shared_model.animate import Face
from shared_model.arrays import Array, Picture
from shared_model.geometry import Camera
from shared_model.mesh import Head
from shared_model.parameters import FaceParameters

# Share of the budget that the first version takes: its background, and a mean texture that is soon
# replaced.
BOOTSTRAP_SHARE = 0.3
# Of the texture of a base layer, at most: `split_into_layers` leaves it 724 to 744.
FIRST_TEXTURE_BYTES = 720
# Bytes of these, against those of one picture.
LAYER_BYTES = 1.85
# Texels and pixels that a frame is fitted by.  Twice as many texels take 4 ms a frame more and gave
# .04 dB less over the face, mean of seven live clips; twice as many pixels gained nothing on two.
FIT_TEXELS, IMAGE_FIT_PIXELS = 2500, 3000


class ModelTrainer:
    """Trains models of one person.

    background: what is behind the person.
    budget: of a whole version.
    progressive: versions are sent in layers.
    workers: see `parallel_map`.
    layer_updates: numbers of the versions that bring layers, counted from the person's first.
    encode_background: encodes it while the first version is trained: each takes as long as many
        frames.  Where that fails it is encoded after the training.
    first_number: of the person's first version; not 0 where they follow somebody else.
    """

    def __init__(
        self,
        head: Head,
        video: VideoFormat,
        gop: GopStructure,
        background: BackgroundImage | FirstLayers,
        budget: ModelBudget,
        progressive: bool,
        workers: int | None,
        layer_updates: frozenset[int] = LAYER_UPDATES,
        encode_background: EncodeBackground = encoded_in_a_thread,
        first_number: int = 0,
    ) -> None:
        self._first_number = first_number
        self._head, self._video, self._gop = head, video, gop
        self._background, self._budget = background, budget
        self._progressive, self._workers = progressive, workers
        self._layer_updates = layer_updates
        self._identity: IdentityFit | None = None  # of the version before
        self._frame_layers: FrameLayers | None = None  # of the background in use
        self._background_data: Future[bytes] | bytes | None = None
        self._hand_watch = HandWatch()
        self._hands: dict[bytes, Outlines] = {}  # of the frames of the version before
        if not progressive:
            self._background_data = encode_background(background, budget.background_bytes)

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs to go on."""
        known = None if self._background_data is None else self._encoded_background()
        return self.__dict__ | {"_background_data": known}

    def bootstrap(
        self,
        pictures: Sequence[Picture],
        points: Sequence[Array],
        share: float | None = None,
    ) -> ModelVersion:
        """The first version: mean texture and background.

        share: of the budget for a face that has been seen for long enough to have modes; None: it
            has not, and there are none.
        A progressive one is a base layer and nothing more: what else the first frame shows, the
        first update has, too, better and in as many bytes.
        """
        budget = self._first_budget(share)
        if self._progressive:
            # A call over a thin link waits for this: it takes no more than what fits.
            budget = replace(budget, background_bytes=0, appearance_bytes=FIRST_TEXTURE_BYTES)
        version = self.train(budget, pictures, points, 0)
        return self._base_layer_only(version) if self._progressive else version

    def follow(self, pictures: Sequence[Picture], points: Sequence[Array]) -> ModelVersion:
        """The first version of a person who follows somebody else in a call: an update."""
        version = self.train(self._first_budget(None), pictures, points, self._first_number)
        if not self._progressive:
            return version
        return self._in_layers(version, UPDATE_BASE_LAYER_BYTES)

    def _first_budget(self, share: float | None) -> ModelBudget:
        appearance_bytes = int((share or BOOTSTRAP_SHARE) * self._budget.appearance_bytes)
        max_modes = 0 if share is None else self._budget.max_modes
        return replace(self._budget, appearance_bytes=appearance_bytes, max_modes=max_modes)

    def retrain(
        self, share: float, pictures: Sequence[Picture], points: Sequence[Array], number: int
    ) -> ModelVersion:
        """Version `number`, an update, whose face takes `share` of the budget.

        Unless it is progressive the decoder keeps the background that it has, or gets a newer one.
        """
        budget = replace(self._budget, appearance_bytes=int(share * self._budget.appearance_bytes))
        if not self._progressive:
            return self.train(replace(budget, background_bytes=0), pictures, points, number)
        version = self.train(budget, pictures, points, number)
        return self._in_layers(version, UPDATE_BASE_LAYER_BYTES)

    def train(
        self, budget: ModelBudget, pictures: Sequence[Picture], points: Sequence[Array], number: int
    ) -> ModelVersion:
        """Version `number` from pictures (h, w, 3) BGR and their landmarks (468, 3), pixels.

        It is complete but for its place in the call, see `ModelVersion.placed_at`.  With a budget
        of no bytes for the background an update has one only where that of before is outdated.
        """
        hands = self._find_hands(pictures, points)
        trained = self._train_person(budget, pictures, points, hands)
        call = self._call_parameters(trained.person.fitted.camera.focal_px)
        # The first one shows the reference, whatever else it shows.
        shown = sorted({0, *without_hands(hands)})
        frames = _fitted_frames(trained, call.camera, pictures, points, shown)
        background = self._background_for(number, budget, frames)
        layers = None if self._frame_layers is None else self._frame_layers.of_person(frames)
        faces = trained.faces if layers is None else layers.fitted_all(frames)
        return self._version(number, trained, call, background, faces, layers)

    def _version(
        self,
        number: int,
        trained: TrainedModel,
        call: CallParameters,
        background: bytes,
        faces: Sequence[FaceParameters],
        layers: FrameLayers | None,
    ) -> ModelVersion:
        """A version of a trained person.  faces: of the sample, with their layer coefficients."""
        person, distortion_model = trained.person, distortion_of(trained)
        distortion = live_distortion(distortion_model, person.texel_fitter.template.modes, layers)
        transform = transform_from_prior(
            np.array([vector_from_face(face, person.reference.pose) for face in faces]),
            distortion,
            person.appearance.modes,
            frames_per_packet=self._gop.frames_per_packet,
            frame_step=self._gop.frame_step,
            layer_variance=None if layers is None else layers.prior_variance,
        )
        packet = replace(
            build_model_packet(person, transform, call, background),
            version=number,
            version_count=number + 1,
            profile_data=serialise_transform(with_reserved_modes(transform, RESERVED_MODES)),
            extensible=True,
        )
        landmarks = self._landmark_model(person.fitted)
        fitter = person.image_fitter(IMAGE_FIT_PIXELS)
        return ModelVersion(
            packet,
            person,
            landmarks,
            transform,
            distortion_model,
            distortion,
            fitter,
            frame_layers=layers,
        )

    def _background_for(self, number: int, budget: ModelBudget, frames: FittedFrames) -> bytes:
        """The background of version `number`; empty: the one before stays."""
        number -= self._first_number
        is_relit = number > 0 and self._relight(frames.pictures[-1])
        learned = b""
        # A person whose first version has modes has been seen for long enough.
        is_known = number > 0 or budget.max_modes > 0
        if is_known and number in self._layer_updates and not self._progressive:
            learned = self._learn_layers(frames)
        if learned or not (budget.background_bytes or is_relit):
            return learned
        if budget.background_bytes and isinstance(self._background, FirstLayers):
            self._frame_layers = self._background.frame_layers(frames)
        return self._encoded_background()

    def _relight(self, newest: Picture) -> bool:
        """Give a background without layers the light of a frame; whether it had another."""
        if self._frame_layers is not None or not isinstance(self._background, BackgroundImage):
            return False
        relit = background_in_light(self._background, newest)
        if relit is not None:
            self._background, self._background_data = relit, None
        return relit is not None

    def _learn_layers(self, frames: FittedFrames) -> bytes:
        """The background with layers; empty if the person cannot be told from the scene."""
        learned, _ = layers_of_person(frames, follows_light=True, workers=self._workers)
        if learned is None:
            return b""
        self._frame_layers = learned.frames.with_wide_limits()
        return learned.encode(int(LAYER_BYTES * self._budget.background_bytes))

    def _find_hands(self, pictures: Sequence[Picture], points: Sequence[Array]) -> list[Outlines]:
        """The hands in each frame."""
        if len(points) == 1:
            # All that there is to learn from.
            return [[]]
        found, self._hands = self._hand_watch.find_in_series(pictures, points, self._hands)
        return that_come_and_go(found)

    def _train_person(
        self,
        budget: ModelBudget,
        pictures: Sequence[Picture],
        points: Sequence[Array],
        hands: Sequence[Outlines],
    ) -> TrainedModel:
        size = (self._video.width, self._video.height)
        identity, faces = fit_sequence(self._head, size, points, self._identity)
        self._identity = identity
        # Eyelids as `ModelVersion.fit_texels` finds them.
        landmarks = self._landmark_model(identity)
        faces = [
            fit_with_eyelids(landmarks, identity.camera, each, face)
            for each, face in zip(points, faces, strict=True)
        ]
        # Later frames show what these hide in the mouth and behind the eyelids.
        options = PersonModelOptions(
            budget.texture_size,
            budget.appearance_bytes,
            budget.max_modes,
            image_space_fit=False,
            weight_disoccluded=True,
            weight_mouth=True,
            nominal_texels=FIT_TEXELS,
            searches_step=False,
        )
        return build_person_model(
            identity,
            Face(self._head, quantised_identity(self._head, identity)),
            self._call_parameters(identity.camera.focal_px).camera,
            faces,
            list(enumerate(pictures)),
            points,
            options,
            self._workers,
            hands,
        )

    def _in_layers(self, version: ModelVersion, base_bytes: int = BASE_LAYER_BYTES) -> ModelVersion:
        mean = version.person.appearance.mean
        layers = split_into_layers(version.packet, mean, self._background, base_bytes)
        return replace(version, packet=layers.base, layers=layers)

    def _base_layer_only(self, version: ModelVersion) -> ModelVersion:
        """The version with the appearance that its base layer has."""
        version = self._in_layers(version)
        texture = version.packet.texture
        if texture == version.person.appearance.texture:
            return replace(version, layers=None)
        mean = decode_picture("texture", texture)
        appearance = replace(
            version.person.appearance, texture=texture, mean=mean, mode_codec=ModeCodec(len(mean))
        )
        person = replace(version.person, appearance=appearance)
        fitter = person.image_fitter(IMAGE_FIT_PIXELS)
        return replace(version, person=person, image_fitter=fitter, layers=None)

    def _encoded_background(self) -> bytes:
        data = self._background_data
        if isinstance(data, Future):
            data = data.result() if data.exception() is None else None
        if data is None:
            data = self._background.encode(self._budget.background_bytes)
        self._background_data = data
        return data

    def _landmark_model(self, identity: IdentityFit) -> LandmarkModel:
        return personalise(landmark_model(self._head), identity.identity.aau, identity.control_mm)

    def _call_parameters(self, focal_px: float) -> CallParameters:
        packing = self._gop.frames_per_packet, self._gop.frame_step
        return call_parameters(self._video, "default", focal_px, 0, *packing)


def _fitted_frames(
    trained: TrainedModel,
    camera: Camera,
    pictures: Sequence[Picture],
    points: Sequence[Array],
    shown: Sequence[int],
) -> FittedFrames:
    """Some of the frames that a person was trained from, the first of which shows their reference.

    shown: their numbers.
    """
    outlines, person = [face_outline(points[number]) for number in shown], trained.person
    chosen = [pictures[number] for number in shown], [trained.faces[number] for number in shown]
    return FittedFrames(person.face, camera, *chosen, outlines, 0, person.reference)
