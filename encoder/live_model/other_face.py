"""Another face that a live call shows instead of the caller's, whose own pictures are not sent.

Its model is made of one picture; the caller's motion and actuators move it, from one reference pose
to the other.  It has no modes: these are the caller's looks.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from encoder.capture.video_source import VideoFormat
from encoder.coding.gop import GopStructure
from encoder.coding.model_packet import ModelBudget
from encoder.live_model.call_trainer import CallTrainers
from encoder.live_model.model_version import ModelVersion
from encoder.live_model.pacing import REAL_TIME
from protocol.frames.scalar_quantiser import motion_from_pose, pose_from_motion
from shared_model.arrays import Array, Picture
from shared_model.errors import UserError
from shared_model.parameters import FaceParameters

# Share of the budget for texture and modes that the texture takes: there are no modes.
TEXTURE_SHARE = 0.5


@dataclass(frozen=True, slots=True)
class OtherFace:
    """picture: (h, w, 3) uint8 BGR, with a face in it.  is_shown: asked between frames."""

    picture: Picture
    is_shown: Callable[[], bool]


def version_of_picture(
    picture: Picture,
    find: Callable[[Picture], Array | None],
    video: VideoFormat,
    gop: GopStructure,
    budget: ModelBudget,
) -> ModelVersion:
    """A model of the face in a picture (h, w, 3) BGR, as large as those of `video`.

    find: landmarks (468, 3), pixels, of the face in a picture; None: there is none.
    Raises `UserError` if it finds none.
    """
    points = find(picture)
    if points is not None:
        picture = cut_to(picture, points[:, :2].mean(0), (video.width, video.height))
        points = find(picture)
    if points is None:
        raise UserError("another face: no face is found in that picture")
    trainers = CallTrainers(video, gop, budget, REAL_TIME)
    trainer = trainers.trainer(picture, points, progressive=False)
    texture_bytes = int(TEXTURE_SHARE * budget.appearance_bytes)
    of_one = replace(budget, appearance_bytes=texture_bytes, max_modes=0)
    return trainer.train(of_one, [picture], [points], 0)


def cut_to(picture: Picture, centre: Array, size: tuple[int, int]) -> Picture:
    """The largest part of a picture in the proportions of `size`, scaled to it.

    centre: (2,) pixels; the part is around this as far as there is picture.  size: width, height.
    """
    height, width = picture.shape[:2]
    scale = min(width / size[0], height / size[1])
    part = np.array([scale * size[0], scale * size[1]])
    corner = np.clip(centre - part / 2, 0, np.array([width, height]) - part)
    (left, top), (right, bottom) = np.rint(corner).astype(int), np.rint(corner + part).astype(int)
    way = cv2.INTER_AREA if scale > 1 else cv2.INTER_CUBIC
    return np.asarray(
        cv2.resize(picture[top:bottom, left:right], size, interpolation=way), np.uint8
    )


class FaceChoice:
    """Whose face a call shows: the caller's, or another one.

    other: None: there is no other.  version: its model, see `version_of_picture`.
    """

    def __init__(self, other: OtherFace | None = None, version: ModelVersion | None = None) -> None:
        self._other, self._version = other, version
        self._coding_version: ModelVersion | None = None
        self._background = b""  # the caller's newest
        self._number = -1  # of the newest version that has been sent

    @property
    def coding_version(self) -> ModelVersion | None:
        """The version of the other face that codes frames now; None: the caller's does."""
        return self._coding_version

    @property
    def is_wanted(self) -> bool:
        """Whether to show the other face."""
        return self._version is not None and self._other is not None and self._other.is_shown()

    @property
    def is_hidden(self) -> bool:
        """Whether nothing of the caller's looks is to be sent."""
        return self.coding_version is not None or self.is_wanted

    @property
    def next_number(self) -> int:
        """Number of the next version to send."""
        return self._number + 1

    def begin(self, version: ModelVersion, index: int) -> ModelVersion:
        """The first version to send, for source frame `index`.  version: the caller's."""
        first = self.with_background(version)
        if self.is_wanted:
            first = self._coding_version = self.next_other().placed_at(0, index)
        self.note_sent(first)
        return first

    def switch(self, own: ModelVersion | None, following: ModelVersion) -> ModelVersion | None:
        """Code frames with a version; returns that of the caller, `own` until then."""
        if self.is_other(following):
            self._coding_version = following
            return own
        self._coding_version = None
        return following

    def next_other(self) -> ModelVersion:
        """The version of the other face to send now."""
        assert self._version is not None
        number, packet = self.next_number, self._version.packet
        packet = replace(packet, version=number, version_count=number + 1)
        return replace(self._version, packet=packet)

    def with_background(self, version: ModelVersion) -> ModelVersion:
        """A version of the caller; it brings the background where the other face's is shown."""
        self._background = version.packet.background or self._background
        if self.coding_version is None or version.packet.background:
            return version
        return replace(version, packet=replace(version.packet, background=self._background))

    def note_sent(self, version: ModelVersion) -> None:
        """A version has been sent."""
        self._number = version.number

    def is_other(self, version: ModelVersion) -> bool:
        """Whether a version is of the other face."""
        return self._version is not None and version.person is self._version.person

    def faces(self, faces: Sequence[FaceParameters], own: ModelVersion) -> Sequence[FaceParameters]:
        """The faces to code, of those of the caller that were fitted with `own`."""
        return faces if self.coding_version is None else moved_like(faces, own, self.coding_version)


def moved_like(
    faces: Sequence[FaceParameters], own: ModelVersion, other: ModelVersion
) -> list[FaceParameters]:
    """The face of `other`, moved as the faces of the caller, which were fitted with `own`."""
    before, after = own.packet.reference_pose, other.packet.reference_pose
    poses = [pose_from_motion(motion_from_pose(face.pose, before), after) for face in faces]
    return [FaceParameters(pose, face.eau) for pose, face in zip(poses, faces, strict=True)]
