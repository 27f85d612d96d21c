"""The annotations of imm, ytf and orl that `validate_aam` needs, made where they are missing."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from aam.annotation.annotate import AnnotationOptions, annotate, list_images
from benchmarks.enlarged_landmarks import main as write_enlarged_landmarks

# What names the person in a picture's path; each picture of the others shows another one.
PERSONS = {"imm": "([0-9]+)_", "ytf": "", "orl": "(s[0-9]+)/"}
TRAIN, TEST = ("imm", "ytf"), ("orl",)


@dataclass(frozen=True, slots=True)
class AnnotatedSets:
    """Folders by the network's landmarks for training and test; by given ones, for first frames."""

    train: list[Path]
    test: list[Path]
    truth: list[Path]


def annotated_sets(faces: Path, output: Path, tell: Callable[[str], None]) -> AnnotatedSets:
    """The sets of a folder of faces, below a folder for annotations.

    What is annotated already is passed over.  Raises `UserError`.
    """
    enlarged = output / "orl.csv"
    given = {"imm": ".asf", "ytf": str(faces / "ytf" / "landmarks.csv"), "orl": str(enlarged)}
    output.mkdir(parents=True, exist_ok=True)
    by_network, truth = list[Path](), list[Path]()
    for name, person in PERSONS.items():
        tell(f"annotating {name}")
        images = list_images([faces / name])
        for folder, landmarks, found in (
            (output / "annotated" / name, "network", by_network),
            (output / "truth" / name, given[name], truth),
        ):
            if landmarks == str(enlarged) and not enlarged.exists():
                partial = enlarged.with_suffix(".part")
                write_enlarged_landmarks([str(faces / name), "-o", str(partial)])
                partial.rename(enlarged)
            folder.mkdir(parents=True, exist_ok=True)
            annotate(images, folder, AnnotationOptions(landmarks=landmarks, person=person))
            found.append(folder)
    chosen = dict(zip(PERSONS, by_network, strict=True))
    return AnnotatedSets([chosen[n] for n in TRAIN], [chosen[n] for n in TEST], truth)
