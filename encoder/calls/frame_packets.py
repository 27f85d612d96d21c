"""The frame packets of a live call: their frames are collected, then coded."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import ceil

from encoder.coding.rate_control import OnlineRateController
from encoder.coding.rdo_quantiser import CodedPacket
from encoder.learning.face_sample import FaceSample
from encoder.live_model.model_version import ModelVersion
from protocol.frames.temporal_prediction import FramePredictor
from shared_model.arrays import Array
from shared_model.geometry import interpolate
from shared_model.parameters import FaceParameters

# Share of the way to rest that a face goes from one coded frame to the next.
REST_SHARE = 0.25


@dataclass(frozen=True, slots=True)
class _PendingFrame:
    """A coded frame whose packet is not coded.

    sample: what the face was fitted to; None: there was nothing to fit to.
    repeats: the frame repeats the one before, since no face was visible.
    is_outdated: there are modes that the face has not been fitted with.
    holds_layers: its layer coefficients are those of the frame before.
    """

    face: FaceParameters
    sample: FaceSample | None = None
    repeats: bool = False
    is_outdated: bool = False
    holds_layers: bool = False


@dataclass(frozen=True, slots=True)
class FilledPacket:
    """The faces of one frame packet.

    start_frame: source frame of the first.  visible: whether any frame has a face of its own.
    """

    start_frame: int
    faces: tuple[FaceParameters, ...]
    visible: bool


class PacketFiller:
    """The frames of one packet after the other.

    frame_step: source frames from one coded frame to the next.
    """

    def __init__(self, frame_step: int) -> None:
        self._frame_step = frame_step
        self._start_frame = 0
        self._pending: list[_PendingFrame] = []
        self._face: FaceParameters | None = None  # of the newest coded frame
        self._is_interrupted = False  # whether a frame without a face came after it

    def __len__(self) -> int:
        """Number of frames that wait."""
        return len(self._pending)

    @property
    def start_frame(self) -> int:
        """Source frame that the packet begins with."""
        return self._start_frame

    @property
    def next_index(self) -> int:
        """The source frame that is coded next."""
        return self._start_frame + len(self._pending) * self._frame_step

    @property
    def initial_face(self) -> FaceParameters | None:
        """Where the fit of the next frame begins; None: the frame before shows no face."""
        return None if self._is_interrupted else self._face

    def start_at(self, frame: int) -> None:
        """Begin the call's first packet with source frame `frame`."""
        self._start_frame = frame

    def is_coded(self, index: int) -> bool:
        """Whether source frame `index` is the next coded one."""
        return index == self.next_index

    def add(self, face: FaceParameters, sample: FaceSample) -> None:
        """Add the next coded frame, with its face as fitted to `sample`.

        Frames before it whose samples have no picture of the layers get coefficients in between.
        """
        self._face, self._is_interrupted = face, False
        holds_layers = sample.coarse is None
        if not holds_layers:
            self._spread_layers(face.layers)
        self._pending.append(_PendingFrame(face, sample, holds_layers=holds_layers))

    def _spread_layers(self, after: Array) -> None:
        """Lead the layer coefficients of the newest frames to those of the next one."""
        first = len(self._pending)
        while first and self._pending[first - 1].holds_layers:
            first -= 1
        held = self._pending[first:]
        for number, frame in enumerate(held, 1):
            before = frame.face.layers
            if len(before) == len(after):
                between = before + number / (len(held) + 1) * (after - before)
                face = replace(frame.face, layers=between)
                self._pending[first + number - 1] = replace(frame, face=face)

    def add_rest(self, rest: FaceParameters) -> None:
        """Add the next coded frame while the camera is off: the face goes to rest, and stays.

        rest: with as many modes as the faces.
        """
        before = rest if self._face is None else self._face
        self._face, self._is_interrupted = interpolate(before, rest, REST_SHARE), True
        self._pending.append(_PendingFrame(self._face))

    def fill_gap(self, index: int, limit: int, face: FaceParameters | None = None) -> None:
        """Add the coded frames before source frame `index` that the source has left out.

        They lead from the newest face to `face`; None: they repeat it, as a frame without a face if
        the one before is.
        limit: no more frames than these wait then.
        """
        if self._face is None:
            return
        missing = max(0, ceil((index - self.next_index) / self._frame_step))
        before, after = self._face, self._face if face is None else face
        for number in range(1, min(missing, limit - len(self._pending)) + 1):
            between = interpolate(before, after, number / (missing + 1))
            repeats = face is None and self._is_interrupted
            self._pending.append(_PendingFrame(between, repeats=repeats))

    def add_without_face(self, index: int) -> None:
        """Note that source frame `index` shows no face; if it is coded, it repeats the newest one.

        Raises `ValueError` if no face has been added yet.
        """
        if self._face is None:
            raise ValueError(f"frame {index} has no face before it, expected one to repeat")
        self._is_interrupted = True
        if self.is_coded(index):
            self._pending.append(_PendingFrame(self._face, repeats=True))

    def mark_outdated(self) -> None:
        """Note that there are new modes: faces that wait should be fitted again."""
        self._pending = [
            replace(frame, is_outdated=frame.sample is not None) for frame in self._pending
        ]

    def refit_newest(self, refit: Callable[[FaceSample, FaceParameters], FaceParameters]) -> bool:
        """Fit the newest outdated face again with the newest modes; whether there was one.

        refit: fits a face again to its sample.
        Frames after it that have nothing to be fitted to get its face, or only its modes.
        """
        outdated = (i for i in reversed(range(len(self._pending))) if self._pending[i].is_outdated)
        at = next(outdated, None)
        if at is None:
            return False
        frame = self._pending[at]
        assert frame.sample is not None
        face = refit(frame.sample, frame.face)
        self._pending[at] = replace(frame, face=face, is_outdated=False)
        for later in range(at + 1, len(self._pending)):
            frame = self._pending[later]
            if frame.sample is not None:
                break
            face = face if frame.repeats else replace(frame.face, modes=face.modes)
            self._pending[later] = replace(frame, face=face)
        self._face = self._pending[-1].face
        return True

    def reset_coefficients(self, rest: FaceParameters) -> None:
        """Set the newest face's coefficients to 0: it is of another version than `rest` is."""
        if self._face is not None:
            self._face = replace(self._face, modes=rest.modes, layers=rest.layers)

    def take(self, count: int) -> FilledPacket:
        """The first `count` of the frames that wait, or all; the next packet begins after them."""
        taken, self._pending = self._pending[:count], self._pending[count:]
        faces = tuple(frame.face for frame in taken)
        visible = any(not frame.repeats for frame in taken)
        filled = FilledPacket(self._start_frame, faces, visible)
        self._start_frame += len(faces) * self._frame_step
        return filled


class PacketCoder:
    """Holds the state that a decoder has, too: the packet number and the predictor.

    on_packet: see `CallEvents`.
    """

    def __init__(
        self, rate: OnlineRateController, on_packet: Callable[[Array, CodedPacket], None]
    ) -> None:
        self._rate, self._on_packet = rate, on_packet
        self._number = 0
        self._predictor: FramePredictor | None = None

    @property
    def number(self) -> int:
        """Number of the next packet in the call."""
        return self._number

    def code(self, version: ModelVersion, faces: Sequence[FaceParameters]) -> bytes:
        """The payload of the next packet.

        version: the one in use, with its newest modes.  Its first packet starts a new predictor.
        """
        number = self._number - version.first_packet
        if self._predictor is None or not number:
            transform = version.padded_transform
            self._predictor = FramePredictor(transform.scale_codes, transform.reserved_modes)
        targets = version.transform_faces(faces)
        packet = self._rate.encode_packet(self._predictor, number, targets)
        self._on_packet(targets, packet)
        self._predictor.anchor = packet.frames[-1]
        self._number += 1
        return packet.payload
