"""A picture as a decoder draws it, before it has its residual."""

from dataclasses import dataclass

from shared_model.arrays import Picture, Single


@dataclass(frozen=True, slots=True)
class DrawnPicture:
    """The picture (h, w, 3) uint8 BGR of source frame `index`.

    face_area: (h, w) 1 on the face, 0 around it, in between at its edge.
    """

    index: int
    picture: Picture
    face_area: Single
