"""Annotate pictures one by one: find landmarks or take given ones, fit, write both files."""

import hashlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from aam.annotation.annotation_file import Annotation, read_header
from aam.annotation.held_values import HeldValues, eaus_option
from aam.annotation.landmark_files import read_landmark_csv, read_landmark_file
from aam.annotation.landmark_schemes import FaceLandmarks, from_given, from_search
from aam.annotation.landmark_search import ModelLandmarks, StillLandmarks
from aam.annotation.originals import save_fit
from aam.annotation.still_fit import StillFit, fit_still
from aam.annotation.still_texture import kept_texture, kept_window
from aam.model_file import BUILTIN, named_model
from shared_model.arrays import Array, Picture
from shared_model.errors import NO_FACE, UserError, cannot_read
from shared_model.mesh import generic_head

Progress = Callable[[int, int], None]

SUFFIXES = {".jpg", ".jpeg", ".png", ".pgm", ".ppm", ".bmp", ".tif", ".tiff", ".webp"}
# What `contact_sheet` writes beside annotations.
CONTACT_SHEET = re.compile(r"contact_\d{3,}\.jpg")
LANDMARK_SUFFIXES, MODEL_SUFFIX = (".asf", ".pts"), ".npz"


@dataclass(frozen=True, slots=True)
class AnnotationOptions:
    """How pictures are annotated.

    projection: see `still_fit.PROJECTIONS`.  residual: fit the residual shape as well.
    landmarks: "network", ".asf" or ".pts" for files beside the pictures, the path of a CSV, or of a
        trained model (.npz), or `BUILTIN`.
    eaus: which actuators are fitted, one of `EAU_SETS`; the others are at rest.
    person: a regular expression whose first group in the picture's path names the person; "": each
        picture shows another one.
    """

    projection: str = "weak"
    residual: bool = False
    landmarks: str = "network"
    person: str = ""
    eaus: str = "all"

    @property
    def text(self) -> str:
        """All that changes the result of a fit."""
        residual = " residual" if self.residual else ""
        eaus = "" if self.eaus == "all" else f" {eaus_option(self.eaus)}"
        return f"{self.projection}{residual} landmarks={self.landmarks}{eaus}"


@dataclass(slots=True)
class AnnotationReport:
    """What came of a run: names of all annotations, how many are new, pictures that have none.

    exit_code: of the process: 0, or of the first picture without one: 3 no face, 2 no picture.
    """

    names: list[str] = field(default_factory=list)
    fitted: int = 0
    failures: list[str] = field(default_factory=list)
    exit_code: int = 0


def annotate(
    images: Sequence[Path],
    folder: Path,
    options: AnnotationOptions,
    progress: Progress = lambda done, total: None,
    stop: Callable[[], bool] = lambda: False,
) -> AnnotationReport:
    """Annotate pictures into a folder; those with a whole annotation of the same are passed over.

    A picture that shows no face, or cannot be read, is noted and the others go on.
    Raises `UserError` where no picture could be annotated for a reason that holds for all.
    """
    given = _GivenLandmarks(options.landmarks)
    report = AnnotationReport()
    names = annotation_names(images)
    for done, (path, name) in enumerate(zip(images, names, strict=True)):
        if stop():
            break
        try:
            if not _is_done(folder / f"{name}.json", path, options):
                _annotate_one(folder, path, name, given, options)
                report.fitted += 1
            report.names.append(name)
        except _NotAnnotated as error:
            report.failures.append(f"{path}: {error}")
            report.exit_code = report.exit_code or error.exit_code
        progress(done + 1, len(images))
    return report


def list_images(paths: Iterable[Path]) -> list[Path]:
    """The pictures among the paths, and all pictures in folders among them but contact sheets.

    Raises `UserError`.
    """
    found: list[Path] = []
    for path in paths:
        if path.is_dir():
            pictures = sorted(p for p in path.rglob("*") if p.suffix.lower() in SUFFIXES)
            inside = [p for p in pictures if not CONTACT_SHEET.fullmatch(p.name)]
            if not inside:
                raise UserError(f"{path} holds no pictures ({', '.join(sorted(SUFFIXES))})")
            found += inside
        elif path.is_file():
            found.append(path)
        else:
            raise UserError(f"cannot read {path}: no such file")
    return found


def annotation_names(images: Sequence[Path]) -> list[str]:
    """A name for each picture: its file's, after so many folders that no two names are alike."""
    for depth in range(1, 8):
        names = ["_".join(path.with_suffix("").parts[-depth:]) for path in images]
        if len(set(names)) == len(names):
            return names
    raise UserError("two of the pictures have the same path; name each once")


class _NotAnnotated(Exception):
    """A picture that cannot be annotated; the message says why.  exit_code: see `UserError`."""

    def __init__(self, message: str, exit_code: int = 2) -> None:
        super().__init__(message)
        self.exit_code = exit_code


class _GivenLandmarks:
    """Where landmarks come from, see `AnnotationOptions.landmarks`."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._search: StillLandmarks | ModelLandmarks | None = None
        self._table: Mapping[str, Array] = {}
        if source == "network":
            self._search = StillLandmarks()
        elif source == BUILTIN or source.endswith(MODEL_SUFFIX):
            self._search = ModelLandmarks(named_model(source))
        elif source not in LANDMARK_SUFFIXES:
            self._table = read_landmark_csv(Path(source))

    def of(self, path: Path, picture: Picture) -> FaceLandmarks:
        """The landmarks in a picture.  Raises `_NotAnnotated`."""
        if self._search is not None:
            points = self._search.find(picture)
            if points is None:
                raise _NotAnnotated("no face found", NO_FACE)
            return from_search(points)
        try:
            return from_given(self._given(path, picture))
        except (UserError, ValueError) as error:
            raise _NotAnnotated(str(error)) from error

    def _given(self, path: Path, picture: Picture) -> Array:
        if self._source in LANDMARK_SUFFIXES:
            size = picture.shape[1], picture.shape[0]
            return read_landmark_file(path.with_suffix(self._source), size)
        for name in (str(path), path.name, path.stem, f"{path.parent.name}/{path.name}"):
            if name in self._table:
                return self._table[name]
        raise UserError(f"{self._source} has no line for it")


def _is_done(json_path: Path, image: Path, options: AnnotationOptions) -> bool:
    if not json_path.is_file() or not json_path.with_suffix(".npz").is_file():
        return False
    try:
        header = read_header(json_path)
    except UserError:
        return False
    wanted = (_sha256(image), options.text, _person(image, options.person, json_path.stem))
    return (header.get("image_sha256"), header.get("options"), header.get("person")) == wanted


def _annotate_one(
    folder: Path, path: Path, name: str, given: _GivenLandmarks, options: AnnotationOptions
) -> None:
    picture = _read_picture(path)
    landmarks = given.of(path, picture)
    size = picture.shape[1], picture.shape[0]
    try:
        held = HeldValues.of_options(options.text)
        fitted = fit_still(
            generic_head(), size, landmarks, options.projection, options.residual, held
        )
        annotation = _annotation(path, name, options, fitted, landmarks, picture)
        save_fit(folder, annotation, picture)
    except ValueError as error:
        raise _NotAnnotated(str(error)) from error


def _annotation(
    path: Path,
    name: str,
    options: AnnotationOptions,
    fitted: StillFit,
    landmarks: FaceLandmarks,
    picture: Picture,
) -> Annotation:
    return Annotation(
        name,
        _person(path, options.person, name),
        str(path),
        _sha256(path),
        options.text,
        fitted.projection,
        fitted.camera.focal_px,
        fitted.error,
        fitted.pose,
        fitted.shape,
        fitted.control_mm,
        kept_texture(picture, fitted),
        landmarks.points,
        kept_window(picture, fitted),
    )


def _read_picture(path: Path) -> Picture:
    picture = cv2.imread(str(path), cv2.IMREAD_COLOR)
    if picture is None:
        raise _NotAnnotated("not a picture that can be read")
    return np.asarray(picture, np.uint8)


def _person(path: Path, pattern: str, name: str) -> str:
    if not pattern:
        return name
    match = re.search(pattern, str(path))
    if match is None or not match.groups():
        raise _NotAnnotated(f"--person {pattern} names nobody in its path")
    return match.group(1)


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise _NotAnnotated(str(cannot_read(path, error))) from error
