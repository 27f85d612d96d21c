"""The layers behind the face in each frame: how the person moves, and how both layers change."""

import numpy as np

from decoder.rendering.layer_colours import NO_CHANGE
from decoder.scene.background_layers import BackgroundLayers
from protocol.pictures.layered_background import LIGHT_COEFFICIENTS, SCENE_COEFFICIENTS
from shared_model.arrays import Array, Picture
from shared_model.layers.head_motion import BackgroundMesh
from shared_model.layers.layer_motion import fields_at_mesh, own_motion
from shared_model.layers.light import Light, light_of
from shared_model.layers.scene_motion import moved_corners


class LayerMotion:
    """What a frame's layer coefficients do to the layers of a background."""

    def __init__(self, mesh: BackgroundMesh, layers: BackgroundLayers) -> None:
        fields_px, changes = layers.fields_px, layers.changes
        self._fields = None
        if fields_px is not None and len(fields_px):
            self._fields = fields_at_mesh(mesh, fields_px)
        self._size = (mesh.camera.width, mesh.camera.height) if layers.scene_moves else None
        self._changes = changes if changes is not None and len(changes) else None
        self._count = 0 if fields_px is None else len(fields_px)
        # Of the first coefficients of the scene and of the light.
        self._scene = self._count + (0 if self._changes is None else len(self._changes))
        self._light = self._scene + SCENE_COEFFICIENTS * layers.scene_moves
        self._light_changes = layers.light_changes

    def own_motion(self, coefficients: Array) -> Array | None:
        """(rows, columns, 2) pixels, see `head_motion.warp`; None if there are no fields."""
        return None if self._fields is None else own_motion(self._fields, coefficients)

    def scene_corners(self, coefficients: Array) -> Array | None:
        """See `scene_motion.moved_corners`; None if the scene stands still."""
        if self._size is None:
            return None
        own = coefficients[self._scene : self._scene + SCENE_COEFFICIENTS]
        return moved_corners(*self._size, own)

    def light(self, coefficients: Array) -> Light | None:
        """The light on both layers; None if it does not change."""
        if not self._light_changes:
            return None
        return light_of(coefficients[self._light : self._light + LIGHT_COEFFICIENTS])

    def change(self, coefficients: Array) -> Picture | None:
        """(h, w, 3) uint8 BGR, `NO_CHANGE` more than what to add to both; None: there is nothing.

        coefficients: of a frame, missing ones are 0.
        """
        if self._changes is None:
            return None
        used = coefficients[self._count : self._count + len(self._changes)].astype(np.float32)
        flat = used @ self._changes[: len(used)].reshape(len(used), self._changes[0].size)
        flat += np.float32(NO_CHANGE + 0.5)
        return np.asarray(np.clip(flat, 0, 255), np.uint8).reshape(self._changes.shape[1:])
