"""What an annotation keeps of its picture: the shape-free texture and the window of the face."""

from aam.annotation.still_fit import StillFit
from aam.window import FaceWindow, face_window
from encoder.appearance.texture import extract_texture
from shared_model.animate import Face, identity_from_controls
from shared_model.appearance import atlas_of
from shared_model.arrays import Array, Picture
from shared_model.mesh import generic_head

# Largest side of the window that is kept, pixels, and of the texture, texels.
WINDOW_PX, TEXTURE_SIZE = 384, 256


def kept_window(picture: Picture, fitted: StillFit) -> FaceWindow:
    """The window of a picture (h, w, 3) that an annotation keeps."""
    return face_window(picture, fitted.pose, WINDOW_PX)


def kept_texture(picture: Picture, fitted: StillFit) -> Picture:
    """(TEXTURE_SIZE, TEXTURE_SIZE, 3) uint8 BGR, of a picture (h, w, 3)."""
    head, vertices = generic_head(), fitted_vertices(fitted)
    atlas = atlas_of(head, TEXTURE_SIZE)
    return extract_texture(head, atlas, fitted.camera, fitted.face.pose, vertices, picture)


def fitted_vertices(fitted: StillFit) -> Array:
    """(n, 3) vertices of the head as it was fitted, mm, head frame."""
    head = generic_head()
    identity = identity_from_controls(head, fitted.aau, fitted.control_mm)
    return Face(head, identity).animate(fitted.face.eau)
