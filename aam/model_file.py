"""The file of a trained model: arrays in NumPy's .npz, without pickle, the same bytes each time.

`header` is a JSON text of what is no array; the arrays of level 0, the coarsest, are `0/...`.
See docs/aam.md.
"""

import json
import os
import zipfile
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from aam.model import AppearanceModel, MultiResolutionModel
from aam.pca import LinearModel
from aam.texture_frame import FRAMES
from encoder.appearance.photometric import NORMALISATIONS
from shared_model.errors import UserError, cannot_read, cannot_write

FORMAT, VERSION = "risorius-aam", 1
_PARTS = ("shape", "texture", "combined")
_MATRICES = ("cascade", "additive", "project_out", "regressed")
# What is stored in half precision in a compact file: nearly all of it.
_HALVED = ("texture_mean", "texture_modes", *_MATRICES)
# Trained on drawn faces, see data/README.md.
BUILTIN = "builtin"
BUILTIN_FILE = "drawn_faces.npz"


def write_model(path: Path, model: MultiResolutionModel, compact: bool = False) -> None:
    """Write a model; the file is there only when it is whole.  Raises `UserError`.

    compact: textures and matrices in half precision, all of it compressed.
    """
    header: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "frame": model.frame,
        "normalisation": model.normalisation,
        "sizes": model.sizes,
        "levels": [_header_of(level) for level in model.levels],
    }
    arrays: dict[str, Any] = {"header": np.array(json.dumps(header, indent=1))}
    for number, level in enumerate(model.levels):
        for part in _PARTS:
            linear = getattr(level, part)
            for name in ("mean", "modes", "variances"):
                arrays[f"{number}/{part}_{name}"] = getattr(linear, name)
        arrays[f"{number}/shape_analysis"] = level.shape.analysis
        for name in _MATRICES:
            arrays[f"{number}/{name}"] = getattr(level, name)
    partial = path.with_name(f"{path.name}.part")
    try:
        with partial.open("wb") as file:
            if compact:
                np.savez_compressed(file, allow_pickle=False, **_halved(arrays))
            else:
                np.savez(file, allow_pickle=False, **arrays)
        os.replace(partial, path)
    except OSError as error:
        raise cannot_write(path, error) from error


def read_model(path: Path) -> MultiResolutionModel:
    """Read a model.  Raises `UserError` for what is none, damaged or of another version."""
    try:
        with np.load(path, allow_pickle=False) as data:
            arrays = {name: _single(data[name]) for name in data.files}
    except OSError as error:
        raise cannot_read(path, error) from error
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        raise UserError(f"{path} is no model: {error}; make one by: risorius train") from error
    try:
        return _model_of(arrays)
    except (KeyError, ValueError, TypeError) as error:
        raise UserError(f"{path} is no model: {error}; make one by: risorius train") from error


def _halved(arrays: dict[str, Any]) -> dict[str, Any]:
    return {
        name: array.astype(np.float16) if name.partition("/")[2] in _HALVED else array
        for name, array in arrays.items()
    }


def _single(array: NDArray[Any]) -> NDArray[Any]:
    return array.astype(np.float32) if array.dtype == np.float16 else array


def _header_of(level: AppearanceModel) -> dict[str, Any]:
    totals = {f"{part}_total": getattr(level, part).total for part in _PARTS}
    return {"shape_weight": level.shape_weight, "contrast": level.contrast, **totals}


def _model_of(arrays: dict[str, Any]) -> MultiResolutionModel:
    header = json.loads(str(arrays["header"]))
    if header["format"] != FORMAT or header["version"] != VERSION:
        raise ValueError(f"it is {header['format']} {header['version']}, not {FORMAT} {VERSION}")
    if header["frame"] not in FRAMES or header["normalisation"] not in NORMALISATIONS:
        raise ValueError(f"frame {header['frame']}, normalisation {header['normalisation']}")
    sizes, levels = tuple(map(int, header["sizes"])), header["levels"]
    if len(sizes) != len(levels) or not sizes:
        raise ValueError(f"{len(levels)} levels of {len(sizes)} sizes")
    found = tuple(_level(arrays, number, values) for number, values in enumerate(levels))
    model = MultiResolutionModel(header["frame"], header["normalisation"], sizes, found)
    for number, level in enumerate(found):
        _check(level, model.warp(number).pose_names, len(model.warp(number).rows))
    return model


def _level(arrays: dict[str, Any], number: int, values: dict[str, Any]) -> AppearanceModel:
    def linear(part: str) -> LinearModel:
        mean, modes, variances = (
            arrays[f"{number}/{part}_{name}"] for name in ("mean", "modes", "variances")
        )
        analysis = arrays[f"{number}/shape_analysis"] if part == "shape" else None
        return LinearModel(mean, modes, variances, float(values[f"{part}_total"]), analysis)

    texels = arrays[f"{number}/texture_mean"].size
    # Models that were trained without it are searched without it.
    arrays.setdefault(f"{number}/regressed", np.zeros((0, texels), np.float32))
    low, high = values["contrast"]
    return AppearanceModel(
        linear("shape"),
        linear("texture"),
        float(values["shape_weight"]),
        linear("combined"),
        (float(low), float(high)),
        *(arrays[f"{number}/{name}"] for name in _MATRICES),
    )


def _check(level: AppearanceModel, pose_names: tuple[str, ...], texels: int) -> None:
    poses = len(pose_names)
    shapes, textures, both = (len(getattr(level, part).variances) for part in _PARTS)
    expected: dict[str, tuple[NDArray[Any], tuple[int, ...]]] = {
        "shape modes": (level.shape.modes, (shapes, level.shape.mean.size)),
        "shape analysis": (np.asarray(level.shape.analysis), (level.shape.mean.size, shapes)),
        "texture modes": (level.texture.modes, (textures, texels)),
        "combined modes": (level.combined.modes, (both, shapes + textures)),
        "cascade": (level.cascade, (len(level.cascade), poses + both, texels)),
        "additive": (level.additive, (poses + both, texels)),
        "project_out": (level.project_out, (poses + shapes, texels)),
        "regressed": (level.regressed, ((poses + both) * bool(len(level.regressed)), texels)),
    }
    for name, (array, shape) in expected.items():
        if array.shape != shape:
            raise ValueError(f"{name} {array.shape}, expected {shape}")


def named_model(name: str | Path) -> MultiResolutionModel:
    """The model `BUILTIN`, or that of a file.  Raises `UserError` if it cannot be read."""
    if str(name) != BUILTIN:
        return read_model(Path(name))
    with as_file(files("aam") / "data" / BUILTIN_FILE) as path:
        return read_model(path)
