"""The picture of a face that is shown instead of one's own: of an image, a call file, or drawn."""

from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
from numpy.typing import NDArray

from decoder.playout import PlayoutFrame
from decoder.reenactment import read_model
from decoder.scene import Scene
from decoder.scene_parts import scene_parts
from encoder.coding.model_packet import reference_face
from protocol.errors import ProtocolError
from risorius.animation.animate import AnimateOptions, animate
from shared_model.errors import UserError
from shared_model.stage_timer import StageTimer

Picture = NDArray[np.uint8]

GENERIC = "generic"
CALL_SUFFIX = ".rzo"
_SCRIPT = "width = 640\nheight = 480\nfps = 1\nseconds = 1\ndistance_mm = 480\n"


def face_picture(name: str) -> Picture:
    """A picture (h, w, 3) uint8 BGR.

    name: of an image, or of a call file, whose person is drawn; `GENERIC`: the generic head.
    Raises `UserError` if there is no such picture.
    """
    if name == GENERIC:
        return _generic_head()
    path = Path(name)
    if not path.is_file():
        raise UserError(f"cannot read {name}: no such file")
    if path.suffix == CALL_SUFFIX:
        return _person_of(path)
    picture = cv2.imread(name, cv2.IMREAD_COLOR)
    if picture is None:
        raise UserError(f"{name} is neither an image nor a call file ({CALL_SUFFIX})")
    return np.asarray(picture, np.uint8)


def _person_of(path: Path) -> Picture:
    model = read_model(path)
    try:
        scene = Scene(scene_parts(model, None))
    except ProtocolError as error:
        raise UserError(f"cannot draw {path}: {error}") from error
    picture = scene.draw(PlayoutFrame(0, reference_face(model), frozen=False), StageTimer())
    scene.close()
    return picture


def _generic_head() -> Picture:
    with TemporaryDirectory() as name:
        folder = Path(name)
        script, pictures = folder / "head.toml", folder / "%d.png"
        script.write_text(_SCRIPT)
        animate(AnimateOptions(script, pictures), lambda done, total: None, lambda: False)
        return face_picture(str(next(folder.glob("*.png"))))
