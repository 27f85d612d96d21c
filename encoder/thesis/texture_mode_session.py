"""The thesis profile with texture modes: tracked faces over an appearance model of the person.

A recorded call is read twice.  First pass: the tracker.  Between the passes: mean texture and modes
of a sample at the tracked faces (thesis eq. 2.17).  Second pass: analysis by synthesis with them
(eq. 2.27), from the tracked faces.  The combined parameters (eq. 2.18) are sent about ten times a
second at the rate of the profile, in packets of the default profile: no decoder needs to know.
"""

from collections.abc import Iterable
from itertools import takewhile

from encoder.calls.face_search import warn_of_long_search
from encoder.calls.session_stats import SessionStats
from encoder.calls.two_pass_session import EncodedCall, code_payloads, hold_last_detection
from encoder.capture.video_source import Capture
from encoder.coding.background import BackgroundImage
from encoder.coding.gop import gop_for_fps
from encoder.coding.model_packet import ModelBudget, build_model_packet, call_parameters
from encoder.coding.transform import transform_call
from encoder.learning.frame_sampler import DENSE_FRAMES, UniformSubsampler
from encoder.thesis.texture_modes import TextureModes, learn_texture_modes
from encoder.thesis.trackers import FaceTracker
from protocol.call_parameters import CallParameters
from protocol.frames.scalar_quantiser import THESIS_RATE_HZ, sent_eaus
from shared_model.arrays import Picture
from shared_model.parameters import EAU_INDEX, FaceParameters


class TextureModeEncoder:
    """A `RecordedPass` that sends the faces of a `FaceTracker` with texture modes.

    modes: at most so many.  eyelids: send the eyelids as well.
    look_for_face_s: as for `ThesisEncoder`.
    """

    def __init__(
        self,
        capture: Capture,
        tracker: FaceTracker,
        modes: int,
        look_for_face_s: float,
        stats: SessionStats,
        eyelids: bool,
    ) -> None:
        self._capture, self._tracker, self._modes = capture, tracker, modes
        self._look_for_face_s, self._stats = look_for_face_s, stats
        self._active = [EAU_INDEX[name] for name in sent_eaus(eyelids)]
        self._gop = gop_for_fps(capture.fps, THESIS_RATE_HZ)
        self._sampler = UniformSubsampler[tuple[int, Picture]](dense_frames=DENSE_FRAMES)
        self._tracked: dict[int, FaceParameters] = {}  # by source frame
        self._fitted: dict[int, FaceParameters] = {}
        self._frames = 0
        self._model: tuple[CallParameters, ModelBudget, TextureModes] | None = None

    @property
    def started(self) -> bool:
        """Whether the first pass has found a face yet."""
        return bool(self._tracked)

    @property
    def faces_fitted(self) -> int:
        """Number of faces that `fit_frames` has fitted."""
        return len(self._fitted)

    def frame(self, index: int, picture: Picture, next_frame: Picture | None = None) -> None:
        """First pass: track the face."""
        self._frames = index + 1
        with self._stats.stage("track" if self.started else "initialise"):
            face = self._tracker.update(picture, next_frame)
        if face is not None:
            self._sampler.offer(len(self._tracked), lambda: (index, picture))
            self._tracked[index] = face
            return
        self._stats.lost_frames += 1
        if not self.started:
            seconds = float(index / self._capture.fps)
            warn_of_long_search(seconds, self._look_for_face_s, self._stats)

    def build_models(self, budget: ModelBudget) -> None:
        """Between the passes: mean texture and modes of the sample at the tracked faces."""
        fitted, start = self._tracker.fitted, min(self._tracked)
        packing = self._gop.frames_per_packet, self._gop.frame_step
        focal_px = fitted.camera.focal_px
        call = call_parameters(self._capture.format, "default", focal_px, start, *packing)
        sampled = [frame for _, frame in self._sampler.frames]
        with self._stats.stage("train"):
            learned = learn_texture_modes(
                fitted, call.camera, self._tracked, sampled, self._active, budget, self._modes
            )
        self._model = call, budget, learned

    def fit_frames(self, frames: Iterable[tuple[int, Picture]]) -> None:
        """Second pass over source frames (index, picture): fit the model in those to be coded."""
        assert self._model is not None
        needed = frozenset(self._coded_frames())
        for index, picture in frames:
            if index in needed:
                with self._stats.stage("fit"):
                    self._fitted[index] = self._model[2].fit(picture, self._tracked[index])

    def encode(self, bitrate: float, progressive: bool = False) -> list[EncodedCall]:
        """The call at `bitrate` bits per second, all frame packets counted, as one part.

        progressive: has no effect.
        """
        assert self._model is not None
        call, budget, learned = self._model
        coded = list(takewhile(self._fitted.__contains__, self._coded_frames()))
        row = {index: number for number, index in enumerate(self._fitted)}
        with self._stats.stage("transform"):
            faces = list(self._fitted.values())
            transform, values = transform_call(learned.trained, faces, call.frames_per_packet)
            _, (_, first) = self._sampler.frames[0]
            background = BackgroundImage(first).encode(budget.background_bytes)
            packet = build_model_packet(learned.trained.person, transform, call, background)
        payloads = code_payloads(
            values[[row[index] for index in coded]],
            transform.scale_codes,
            bitrate,
            self._gop,
            self._capture,
            self._stats,
        )
        stopped_at = call.start_frame + (len(coded) - 1) * call.frame_step + 1
        is_whole = len(coded) == len(self._coded_frames())
        frames = self._frames if is_whole else stopped_at
        lost = frozenset(set(range(call.start_frame, frames)) - set(self._tracked))
        return [EncodedCall(packet, payloads, frames, lost, last_face=stopped_at - 1)]

    def may_have_residual(self, bitrate: float) -> bool:
        """See `RecordedPass`: the profile has none."""
        return False

    def _coded_frames(self) -> list[int]:
        """The source frame whose face each coded frame has."""
        own = {index: index for index in self._tracked}
        held = hold_last_detection(own, min(own), max(own) + 1)
        return held[:: self._gop.frame_step]
