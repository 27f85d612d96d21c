"""vertices = f(identity, parameters): eq. 2.10 with every actuator as a displacement field."""

from copy import copy
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared_model.arrays import Array
from shared_model.mesh import Head
from shared_model.parameters import AAUS, EAUS
from shared_model.shape_residual import residual_basis


@dataclass(frozen=True, slots=True)
class Identity:
    """The shape of a person.

    aau: (len(AAUS),) float64.
    residual: (n, 3) float64, mm, displacement of the vertices in addition to the AAUs.
    """

    aau: Array
    residual: Array


def identity_from_controls(head: Head, aau: Array, control_mm: Array) -> Identity:
    """The identity of AAUs (11,) and displacements (k, 3), mm, of the control points."""
    return Identity(aau, residual_basis(head).T @ control_mm)


class Face:
    """A person's head, animated by one matrix product per frame."""

    def __init__(self, head: Head, identity: Identity) -> None:
        if identity.aau.shape != (len(AAUS),):
            raise ValueError(f"aau has shape {identity.aau.shape}, expected {(len(AAUS),)}")
        self.head = head
        self.neutral = head.vertices + np.tensordot(identity.aau, head.aau, 1) + identity.residual
        up = head.eau_up.reshape(len(EAUS), -1)
        down = head.eau_down.reshape(len(EAUS), -1)
        self._fields = np.ascontiguousarray(np.concatenate([up, down]))

    def with_aau_offset(self, aau: Array) -> "Face":
        """This face with `aau` (len(AAUS),) added to its own AAUs."""
        other = copy(self)
        other.neutral = self.neutral + np.tensordot(aau, self.head.aau, 1)
        return other

    def with_displacement(self, displacement_mm: Array) -> "Face":
        """This face with its vertices displaced by (n, 3) mm."""
        other = copy(self)
        other.neutral = self.neutral + displacement_mm
        return other

    def at_vertices(self, index: NDArray[np.integer]) -> "Face":
        """This face with the vertices `index` (k,) alone."""
        other = copy(self)
        other.neutral = self.neutral[index]
        fields = self._fields.reshape(len(self._fields), -1, 3)[:, index]
        other._fields = np.ascontiguousarray(fields.reshape(len(fields), -1))
        return other

    def animate(self, eau: Array) -> Array:
        """Vertices (n, 3), mm, head frame, of actuators `eau` (len(EAUS),) (eq. 2.10)."""
        if eau.shape != (len(EAUS),):
            raise ValueError(f"eau has shape {eau.shape}, expected {(len(EAUS),)}")
        activation = np.concatenate([np.maximum(eau, 0), np.maximum(-eau, 0)])
        return np.asarray(self.neutral + (activation @ self._fields).reshape(-1, 3))
