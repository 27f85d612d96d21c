"""A folder of annotations that hands correct: the fits without a hand are kept in `originals`."""

from dataclasses import replace
from pathlib import Path

from aam.annotation.annotation_file import (
    Annotation,
    read_annotation,
    read_header,
    write_annotation,
)
from aam.annotation.correction import correct, correction_from
from shared_model.arrays import Picture
from shared_model.errors import UserError, cannot_write

ORIGINALS = "originals"


def read_original(folder: Path, name: str) -> Annotation:
    """The fit without a hand; as it stands where that is not kept.  Raises `UserError`."""
    present = read_annotation(folder / f"{name}.json")
    kept = folder / ORIGINALS / f"{name}.json"
    if not present.correction:
        return present
    return read_annotation(kept) if kept.is_file() else replace(present, correction={})


def save_corrected(folder: Path, original: Annotation, corrected: Annotation) -> None:
    """Write a correction, after the fit that it starts from has been kept.  Raises `UserError`."""
    if corrected.correction:
        beside = folder / ORIGINALS
        try:
            beside.mkdir(exist_ok=True)
        except OSError as error:
            raise cannot_write(beside, error) from error
        write_annotation(beside, original)
    write_annotation(folder, corrected)


def save_fit(folder: Path, fitted: Annotation, picture: Picture) -> None:
    """Write a new fit; what a hand has set of the same picture before is set again.

    Raises `UserError`, `ValueError` where it cannot be.
    """
    values = _set_before(folder / f"{fitted.name}.json", fitted.image_sha256)
    correction = correction_from(values, (picture.shape[1], picture.shape[0]))
    save_corrected(folder, fitted, correct(fitted, picture, correction))


def _set_before(path: Path, image_sha256: str) -> dict[str, object]:
    if not path.is_file():
        return {}
    try:
        header = read_header(path)
    except UserError:
        return {}
    values = header.get("correction", {})
    same = header.get("image_sha256") == image_sha256 and isinstance(values, dict)
    return values if same else {}
