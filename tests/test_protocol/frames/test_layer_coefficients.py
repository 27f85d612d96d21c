"""Layer coefficients in the frame transform: on the wire, in a face, and absent without layers."""

import msgpack  # type: ignore[import-untyped]
import numpy as np
import pytest

from protocol.errors import ProtocolError
from protocol.frames.frame_transform import (
    GEOMETRY_SIZE,
    MAX_BASIS_CODE,
    MAX_LAYER_COEFFICIENTS,
    FrameTransform,
    face_from_coefficients,
    vector_from_face,
    with_reserved_modes,
)
from protocol.frames.temporal_prediction import MAX_SCALE_CODE, PREDICTION_KINDS
from protocol.frames.transform_coding import parse_transform, serialise_transform
from shared_model.geometry import pose_from_euler

REFERENCE = pose_from_euler(4.0, -12.0, 3.0, np.array([30.0, -20.0, 650.0]))
MODES, COMPONENTS = (b"first mode", b"second"), 5


def with_layers(count: int) -> FrameTransform:
    """A transform with so many layer coefficients."""
    rng, d = np.random.default_rng(2), GEOMETRY_SIZE + count + len(MODES)
    scale_codes = rng.integers(0, MAX_SCALE_CODE // 2 + 1, (COMPONENTS, PREDICTION_KINDS))
    basis = rng.integers(-MAX_BASIS_CODE, MAX_BASIS_CODE + 1, (COMPONENTS, d))
    return FrameTransform(
        modes=MODES,
        unit_codes=rng.integers(120, 137, d, dtype=np.uint8),
        mean_codes=rng.integers(-3, 4, d),
        basis=basis.astype(np.int8),
        exponents=rng.integers(-8, 0, COMPONENTS, dtype=np.int8),
        scale_codes=(2 * scale_codes).astype(np.uint8),
        layers=count,
    )


@pytest.mark.parametrize("reserved", [0, 2])
def test_layer_coefficients_survive_the_wire(reserved: int) -> None:
    transform = with_reserved_modes(with_layers(3), reserved)
    parsed = parse_transform(serialise_transform(transform))
    assert serialise_transform(parsed) == serialise_transform(transform) and parsed.layers == 3
    face = face_from_coefficients(parsed, np.zeros(5 + reserved, np.int64), REFERENCE)
    assert (face.layers.shape, face.modes.shape) == ((3,), (len(MODES) + reserved,))
    mean = vector_from_face(face, REFERENCE)
    np.testing.assert_allclose(mean[GEOMETRY_SIZE : GEOMETRY_SIZE + 3], face.layers)
    np.testing.assert_allclose(mean[GEOMETRY_SIZE:], parsed.mean[GEOMETRY_SIZE:], atol=1e-9)


def test_without_layers_their_number_takes_no_bytes() -> None:
    assert b"\xa1l" not in serialise_transform(with_layers(0))
    with pytest.raises(ProtocolError, match="layer coefficients"):
        parse_transform(msgpack.packb({"m": [], "t": b"\x01", "l": 0}))
    with pytest.raises(ProtocolError, match="layer coefficients"):
        parse_transform(msgpack.packb({"m": [], "t": b"\x01", "l": MAX_LAYER_COEFFICIENTS + 1}))
    with pytest.raises(ValueError, match="layer coefficients"):
        with_layers(MAX_LAYER_COEFFICIENTS + 1)
