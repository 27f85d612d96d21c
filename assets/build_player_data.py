"""Write the data of the player, `player/data/player.bin`: the head, the weights of the format, and
the compiled decoder of pictures
(`make player` builds it of `player/wasm`).

The player derives from them what `shared_model` derives from `head.npz`; positions and fields are
in integers, at most 1/32 mm off.  `player/data_file.js` says what the file is.
"""

import argparse
import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.command import run
from protocol.pictures.probability_model import WEIGHT_ARRAYS, ProbabilityModels
from shared_model.aperture_sheets import head_with_aperture_sheets, rim_weights
from shared_model.arrays import Array
from shared_model.mesh import PARTS, Head, generic_head
from shared_model.shape_residual import RIGID_SUPPORTS, control_points, fixed_points
from shared_model.surround import STRIP_WIDTH, head_with_surround, surround_anchors

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "player" / "data" / "player.bin"
BUILT = ROOT / "player" / "built"
# What is compiled of `player/wasm`.
COMPILED = "pictures", "filters", "texture"
WEIGHTS = ROOT / "protocol" / "data" / "probability_model.npz"
# Steps of positions and of fields, mm, and of texture coordinates.
POSITION_STEP_MM, FIELD_STEP_MM, TEXTURE_STEP = 1 / 64, 1 / 16, 1 / 32767
# Landmarks that the player asks for, in this order.
LANDMARKS = "li", "sto_upper", "sto_lower"
Stored = NDArray[Any]


def main(arguments: Sequence[str]) -> None:
    """Write the file."""
    parser = argparse.ArgumentParser("python -m assets.build_player_data", description=__doc__)
    parser.parse_args(arguments)
    DATA.parent.mkdir(exist_ok=True)
    DATA.write_bytes(player_data())
    print(f"{DATA.relative_to(ROOT)}: {DATA.stat().st_size} bytes")


def player_data() -> bytes:
    """The bytes of the file."""
    head = {**_generic_arrays(), **_surround_arrays(), **_residual_arrays()}
    arrays = {**head, **_weights(), **_compiled()}
    types = {name: array.dtype.name for name, array in arrays.items()}
    listed = [[name, types[name], array.size] for name, array in arrays.items()]
    index = json.dumps(listed, separators=(",", ":")).encode()
    return b"".join([struct.pack("<I", len(index)), index, *map(_coded, arrays.values())])


def _coded(array: Stored) -> bytes:
    """The bytes of an array; those of integers so that they compress well, see data_file.js."""
    if array.dtype not in (np.int16, np.int32):
        return array.tobytes()
    values = array.ravel().astype(np.int64)
    if array.dtype == np.int16:
        values = np.diff(values, prepend=0).astype(np.int16).astype(np.int64)
    zigzag = (values << 1 ^ values >> 63).astype("<u8")
    return zigzag.view(np.uint8).reshape(-1, 8)[:, : array.itemsize].T.tobytes()


def _generic_arrays() -> Mapping[str, Stored]:
    head = generic_head()
    return {
        # By coordinate: neighbours are alike.
        "vertices": _steps(head.vertices.T, POSITION_STEP_MM),
        "triangles": head.triangles.T.astype(np.int16),
        "texture_coordinates": _steps(head.texture_coordinates.T, TEXTURE_STEP),
        "parts": head.parts.astype(np.uint8),
        "opacity": head.opacity.astype(np.float32),
        "eau_up": _steps(head.eau_up.transpose(0, 2, 1), FIELD_STEP_MM),
        "eau_down": _steps(head.eau_down.transpose(0, 2, 1), FIELD_STEP_MM),
        "aau": _steps(head.aau.transpose(0, 2, 1), FIELD_STEP_MM),
        "landmarks": np.array([head.landmarks[name] for name in LANDMARKS], np.int16),
    }


def _surround_arrays() -> Mapping[str, Stored]:
    """What `head_with_surround` adds to the generic head, and what it leaves out."""
    generic, sheeted, whole = generic_head(), head_with_aperture_sheets(), head_with_surround()
    first, count = len(generic.vertices), len(sheeted.vertices)
    rims = rim_weights(generic)
    order = np.argsort(-rims, axis=1, kind="stable")[:, :3]
    depths = (rims @ generic.vertices - sheeted.vertices[first:])[:, 2]
    is_new = whole.triangles.max(1) >= first
    return {
        "rim_vertices": order.astype(np.int16),
        "rim_weights": np.take_along_axis(rims, order, 1).astype(np.float32),
        "rim_depths": depths.astype(np.float32),
        "surround_anchors": surround_anchors(sheeted).astype(np.int16),
        "surround_vertices": _steps(whole.vertices[count:].T, POSITION_STEP_MM),
        "surround_kept_triangles": _kept(generic, whole),
        "surround_triangles": whole.triangles[is_new & _is_surround(whole)].T.astype(np.int16),
        "sheet_triangles": whole.triangles[is_new & ~_is_surround(whole)].T.astype(np.int16),
        "added_texture_coordinates": _steps(whole.texture_coordinates[first:].T, TEXTURE_STEP),
        "strip_width": np.array([STRIP_WIDTH], np.float32),
        "surround_parts": whole.parts.astype(np.uint8),
        "surround_opacity": whole.opacity.astype(np.float32),
    }


def _is_surround(whole: Head) -> Stored:
    return np.asarray(whole.parts[whole.triangles[:, 0]] == PARTS.index("surround"))


def _kept(generic: Head, whole: Head) -> Stored:
    """(m,) which triangles of the generic head the whole one has, in the same order."""
    kept = {tuple(triangle) for triangle in whole.triangles.tolist()}
    flags = [tuple(triangle) in kept for triangle in generic.triangles.tolist()]
    return np.array(flags, np.uint8)


def _residual_arrays() -> Mapping[str, Stored]:
    head = generic_head()
    supports = np.full((len(RIGID_SUPPORTS), 4), -1, np.int16)
    for row, names in zip(supports, RIGID_SUPPORTS.values(), strict=True):
        row[: len(names)] = [head.landmarks[name] for name in names]
    return {
        "control_points": control_points(head).astype(np.int16),
        "fixed_points": fixed_points(head).astype(np.int16),
        "rigid_parts": np.array([PARTS.index(part) for part in RIGID_SUPPORTS], np.uint8),
        "rigid_supports": supports,
    }


def _weights() -> Mapping[str, Stored]:
    with np.load(WEIGHTS) as stored:
        return {
            f"{network}_{part}": np.asarray(stored[f"{network}_{part}"], np.int32)
            for network in ProbabilityModels.__slots__
            for part in WEIGHT_ARRAYS
        }


def _compiled() -> Mapping[str, Stored]:
    return {
        f"{name}_wasm": np.frombuffer((BUILT / f"{name}.wasm").read_bytes(), np.uint8)
        for name in COMPILED
    }


def _steps(values: Array, step: float) -> Stored:
    codes = np.rint(values / step)
    assert np.abs(codes).max() < 2**15
    return codes.astype(np.int16)


if __name__ == "__main__":
    run(main)
