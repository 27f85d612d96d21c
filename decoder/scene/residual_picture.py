"""Adds the picture residual to drawn pictures."""

from protocol.picture_residual.inverse_transform import ResidualPictures
from protocol.picture_residual.residual_block import CodedResidual
from shared_model.arrays import Picture, Single


class ResidualPicture:
    """Decodes the residual of each packet once, for all its frames."""

    def __init__(self) -> None:
        self._coded: CodedResidual | None = None
        self._pictures: ResidualPictures | None = None

    def added_to(
        self, picture: Picture, coded: CodedResidual, index: int, face_area: Single
    ) -> Picture:
        """The picture of source frame `index`, (h, w, 3) uint8 BGR, with its residual.

        face_area: (h, w) see `face_area`.
        Raises `ProtocolError` if the residual is damaged, once; then the picture is as it was.
        """
        if coded is not self._coded:
            self._coded, self._pictures = coded, None
            self._pictures = ResidualPictures.from_tiles(coded.parse())
        place = index - coded.first
        if self._pictures is None or not 0 <= place < coded.frames:
            return picture
        return self._pictures.add_to(picture, place, face_area)
