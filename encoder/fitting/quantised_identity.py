"""The identity as a model packet carries it: quantised."""

from encoder.fitting.fit_results import IdentityFit
from protocol.frames.scalar_quantiser import (
    AAU_STEP,
    RESIDUAL_STEP_MM,
    codes_from_values,
    values_from_codes,
)
from shared_model.animate import Identity, identity_from_controls
from shared_model.mesh import Head


def identity_codes(fitted: IdentityFit) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """The codes of the AAUs and of the shape residual's control points, see `ModelPacket`."""
    return (
        codes_from_values(fitted.identity.aau, AAU_STEP),
        codes_from_values(fitted.control_mm, RESIDUAL_STEP_MM),
    )


def quantised_identity(head: Head, fitted: IdentityFit) -> Identity:
    """The identity as the decoder reads it from a model packet.

    Textures are sampled through this shape, so that the rounding of the shape moves no texel.
    """
    aau, residual = identity_codes(fitted)
    control_mm = values_from_codes(residual, RESIDUAL_STEP_MM).reshape(-1, 3)
    return identity_from_controls(head, values_from_codes(aau, AAU_STEP), control_mm)
