"""The picture of a face that is shown instead of one's own: of an image, a call file, or drawn."""

from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from decoder.scene.decoded_model import decoded_model
from decoder.scene.reenactment import read_model
from decoder.scene.scene import Scene
from protocol.errors import ProtocolError
from risorius.animation.animate import open_actor
from risorius.animation.animation_script import parse_script
from shared_model.arrays import Picture
from shared_model.errors import UserError
from shared_model.stage_timer import StageTimer

GENERIC = "generic"
CALL_SUFFIX = ".rzo"
STUDIO = {"width": 640, "height": 480, "distance_mm": 480}


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
        decoded = decoded_model(model)
    except ProtocolError as error:
        raise UserError(f"cannot draw {path}: {error}") from error
    with closing(Scene(decoded)) as scene:
        return scene.draw(model.reference_face, StageTimer())


def _generic_head() -> Picture:
    script = parse_script(STUDIO, Path())
    with closing(open_actor(script, None)) as actor:
        state = script.at(0)
        return actor.draw(state, actor.geometry(state))
