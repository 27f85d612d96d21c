"""All experiments in a row; each returns its part of the tables."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np

from aam.charts import has_charts
from aam.search.search import METHODS, SearchOptions
from aam.training.train import TrainingOptions
from aam.training.train import train as train_model
from aam.validation import tables
from aam.validation.contenders import Contender, train_head, train_planar, train_residual_head
from aam.validation.first_frames import FirstFrames, TruePicture, first_frames
from aam.validation.model_experiments import (
    EQUAL_ERROR_PX2,
    is_near_frontal,
    mode_counts,
    modes_of_equal_error,
    specificity,
)
from aam.validation.plots import convergence_chart, prediction_plot
from aam.validation.prediction_experiments import Matrix, parameter_curves, pose_curves
from aam.validation.samples import Sample, split_people
from aam.validation.search_experiments import (
    Generalisation,
    best_possible,
    convergence,
    generalisation,
    step_sheet,
)
from aam.validation.search_time import search_time
from aam.validation.units.unit_experiment import unit_part

Tell = Callable[[str], None]

# Experiments in the order of the tables; those that compare the AAM of the head with the 2D AAM.
PARTS = (
    *("model", "search", "residual", "speed", "prediction", "variants", "first-frames"),
    *("units", "units-n-sn"),
)
PARTS_OF_PAIR = frozenset({"model", "search", "residual", "speed", "prediction"})
# Of these, those that need the cascade and those that need the regressed matrix.
PARTS_OF_SEARCH = frozenset({"search", "residual", "speed"})
PARTS_OF_MATRICES = frozenset({"search", "speed", "prediction"})
SEED = 1
# Share of the shape's variance that modes keep where they include residual ones.
RESIDUAL_RETAINED = 0.97
# Faces of the training set whose displacements are predicted.
DISPLACED_FACES = 80
# What is changed one by one (2.4.2 to 2.4.5), from the full frame, retinex, W_s as it is.
VARIANTS = {
    "full frame, retinex": {},
    "inside-face frame": {"frame": "inside"},
    "no light normalisation": {"normalisation": "none"},
    "W_s / 3": {"shape_weight": 1 / 3},
    "W_s x 3": {"shape_weight": 3.0},
    "97 % of the variance": {"retained": 0.97},
    "first two modes discarded": {"discard": 2},
    "no mirror images": {"mirror": False},
}


def run_experiments(
    train: Sequence[Sample],
    test: Sequence[Sample],
    truth: Sequence[TruePicture],
    size: int,
    parts: Sequence[str],
    tell: Tell,
) -> Iterator[tuple[str, str | bytes]]:
    """Files by name and content as each part is done: a table for each part, plots, pictures.

    train, test: share no person.  truth: for the first frames.
    size: texels a side of the finest level.  parts: of `PARTS`.
    Raises `ValueError` if they share one.
    """
    if {each.face.person for each in train} & {each.face.person for each in test}:
        raise ValueError("test has people of train")
    options = TrainingOptions(size=size)
    asked = set(parts)
    needed = replace(
        options, cascade=bool(asked & PARTS_OF_SEARCH), regression=bool(asked & PARTS_OF_MATRICES)
    )
    pair = train_pair(train, needed, tell) if asked & PARTS_OF_PAIR else {}
    for part in parts:
        tell(part)
        match part:
            case "model":
                text = model_part(pair, train, test)
            case "search":
                text, drawn = search_part(pair, train, test)
                yield from drawn.items()
            case "residual":
                text = residual_part(pair, train, test, needed)
            case "speed":
                text = speed_part(pair, test)
            case "prediction":
                text, plots = prediction_part(pair, train, test)
                yield from plots.items()
            case "variants":
                text = variant_part(train, test, options, tell)
            case "first-frames":
                text = first_frame_part([*train, *test], truth, options)
            case "units":
                text = unit_part(train, test, size, SEED)
            case "units-n-sn":
                text = unit_part(train, test, size, SEED, "n-sn")
            case _:
                raise ValueError(f"part is {part!r}, expected one of {PARTS}")
        yield f"{part}.md", text


def train_pair(
    train: Sequence[Sample], options: TrainingOptions, tell: Tell
) -> dict[str, Contender]:
    """The AAM of the head and the 2D AAM."""
    tell("training the AAM of the head and the 2D AAM")
    return {"head": train_head(train, options), "2D": train_planar(train, options)}


def model_part(pair: dict[str, Contender], train: Sequence[Sample], test: Sequence[Sample]) -> str:
    """Compactness and specificity (3.1.1, 3.1.3); what the modes can reach on the test set."""
    near, near_test = (list(filter(is_near_frontal, each)) for each in (train, test))
    cells = {}
    for name, each in pair.items():
        shape, combined = modes_of_equal_error(each, near, near_test)
        cells[name] = [
            _joined(mode_counts(each, train)),
            _joined(mode_counts(each, near)),
            f"{shape}, {combined}",
            f"{specificity(each, train, SEED):.1f}",
            f"{best_possible(each, test).error:.1f}",
        ]
    labels = [
        ("shape, texture, combined modes", "-", "-"),
        (f"the same of the {len(near)} faces within 15 degrees", "9, 81, 33", "31, 106, 53"),
        (f"shape, combined modes that leave {EQUAL_ERROR_PX2:g} px^2 of the landmarks", "-", "-"),
        ("specificity, px^2", "6.28", "8.66"),
        ("best possible error of the test set, px^2", "-", "-"),
    ]
    rows = [
        [label, head, cells["head"][number], planar, cells["2D"][number]]
        for number, (label, head, planar) in enumerate(labels)
    ]
    head = ["", "thesis, head", "here, head", "thesis, 2D", "here, 2D"]
    return "## Compactness and specificity\n\n" + tables.table(head, rows)


def search_part(
    pair: dict[str, Contender], train: Sequence[Sample], test: Sequence[Sample]
) -> tuple[str, dict[str, str | bytes]]:
    """Generalisation (Table 3.1); additive searches step by step (Fig. 3.1 to 3.3)."""
    text = f"## Generalisation: {len(test)} pictures of new people\n\n"
    text += "Thesis: exact 49.6 (head) and 89.6 (2D), displaced 66.7 and 145.6.\n\n"
    text += _generalisations(pair, test, METHODS)
    text += "\nStarts at nasion and subnasale (3.2):\n\n"
    text += _generalisations(pair, test, ("cascade", "additive"), "n-sn")
    additive = SearchOptions("additive")
    paths = {name: convergence(each, test, additive, True, SEED) for name, each in pair.items()}
    sheets = {name: step_sheet(each, test, additive, True, SEED) for name, each in pair.items()}
    drawn: dict[str, str | bytes] = {
        f"search_{name}.png": cv2.imencode(".png", sheet)[1].tobytes()
        for name, sheet in sheets.items()
    }
    if has_charts():
        drawn["convergence.svg"] = convergence_chart(paths)
    return text + "\n" + tables.convergence_table(paths), drawn


def residual_part(
    pair: dict[str, Contender],
    train: Sequence[Sample],
    test: Sequence[Sample],
    options: TrainingOptions,
) -> str:
    """The same for a head with modes of what AE shapes leave of the landmarks (3.1.2)."""
    richer = replace(options, shape_retained=RESIDUAL_RETAINED, regression=False)
    head = train_residual_head(train, richer)
    pair = {"head": head, "2D": pair["2D"]}
    counts = ", ".join(str(len(level.shape.variances)) for level in head.levels)
    text = "## Generalisation of the head with residual modes\n\n"
    text += f"Shape modes of the levels: {counts}; best possible error of the test set, px^2: "
    text += f"{best_possible(head, test).error:.1f}.\n\n"
    return text + _generalisations(pair, test, ("cascade", "additive"))


def _generalisations(
    pair: dict[str, Contender],
    test: Sequence[Sample],
    methods: Sequence[str],
    anchors: str = "eyes",
) -> str:
    results: dict[tuple[str, str, str], Generalisation] = {}
    lines = []
    for start, displaced in (("exact", False), ("displaced", True)):
        for method in methods:
            for name, contender in pair.items():
                options = SearchOptions(method)
                each = generalisation(contender, test, options, displaced, SEED, anchors)
                results[name, method, start] = each
            better = results["head", method, start].better_than(results["2D", method, start])
            lines.append(f"- {start} start, {method}: {100 * better:.1f} %")
    text = tables.search_table(results)
    return text + "\nThe head is better (thesis: 83.0 and 85.4 %) in\n\n" + "\n".join(lines) + "\n"


def speed_part(pair: dict[str, Contender], test: Sequence[Sample]) -> str:
    """CPU time of a search, ms."""
    rows = []
    for method in METHODS:
        times = [search_time(each, test, SearchOptions(method)) for each in pair.values()]
        rows.append([method, *(f"{each.median_ms:.1f} ({each.p95_ms:.1f})" for each in times)])
    text = "## CPU time of a search, ms: median (95th percentile)\n\n"
    return text + tables.table(["search", *pair], rows)


def prediction_part(
    pair: dict[str, Contender], train: Sequence[Sample], test: Sequence[Sample]
) -> tuple[str, dict[str, str]]:
    """Displaced pose and parameters (Tables 2.5, 2.6; Fig. 2.20 to 2.22), by either matrix."""
    step = max(len(train) // DISPLACED_FACES, 1)
    sets = {"training set": train[::step], "new people": test[:DISPLACED_FACES]}
    finest = len(pair["head"].levels) - 1
    ways = {"eq. 2.27": Matrix(finest, False), "regression": Matrix(finest, True)}
    both = [(f"{way}, {name}", ways[way], own) for way in ways for name, own in sets.items()]
    pose = {
        name: {label: pose_curves(each, own, matrix) for label, matrix, own in both}
        for name, each in pair.items()
    }
    parameters = {
        f"{name}, {label}": parameter_curves(each, own, matrix)
        for name, each in pair.items()
        for label, matrix, own in both
    }
    coarse = Matrix(0, True)
    both.append(("regression, training set, coarsest level", coarse, sets["training set"]))
    wide = {label: pose_curves(pair["head"], own, at, wide=True) for label, at, own in both}
    text = "\n".join(
        [
            "## Prediction of displaced pose\n",
            tables.pose_table(pose),
            "Linear range of rotations, head, degrees:\n",
            tables.range_table(wide),
            "## Prediction of displaced c\n",
            tables.parameter_table(parameters),
        ]
    )
    known = {way: f"{way}, training set" for way in ways}
    plots = {
        "pose.svg": prediction_plot({way: pose["head"][label] for way, label in known.items()}),
        "rotations.svg": prediction_plot({way: wide[label] for way, label in known.items()}),
        "c.svg": prediction_plot(
            {way: parameters[f"head, {label}"] for way, label in known.items()}, columns=4
        ),
    }
    return text, plots


def variant_part(
    train: Sequence[Sample], test: Sequence[Sample], options: TrainingOptions, tell: Tell
) -> str:
    """Frames, light, W_s and the rest, by additive search."""
    rows = []
    for name, changes in VARIANTS.items():
        tell(f"variant: {name}")
        changed = replace(options, cascade=False, **changes)  # type: ignore[arg-type]
        contender = train_head(train, changed)
        cells = [name]
        for displaced in (False, True):
            each = generalisation(contender, test, SearchOptions("additive"), displaced, SEED)
            cells += [f"{each.error:.1f}", f"{100 * each.right:.1f}"]
        rows.append(cells)
    head = [
        "head, additive search",
        "exact: px^2",
        "below 5 %, %",
        "displaced: px^2",
        "below 5 %, %",
    ]
    return "## Variants\n\n" + tables.table(head, rows)


def first_frame_part(
    train: Sequence[Sample], truth: Sequence[TruePicture], options: TrainingOptions
) -> str:
    """Shares of first frames fitted right; each half of the people by a model of the other half."""
    results: dict[tuple[str, str], list[FirstFrames]] = {}
    for samples, pictures in zip(*folds(train, truth), strict=True):
        model = train_model([each.face for each in samples], options)
        for folder in sorted({each.folder for each in pictures}):
            own = [each for each in pictures if each.folder == folder]
            for way, found in first_frames(model, own).items():
                results.setdefault((folder, way), []).append(found)
    rows = []
    for folder, way in sorted(results):
        halves = results[folder, way]
        each = FirstFrames(
            np.concatenate([half.nme for half in halves]),
            np.concatenate([half.nme_shifted for half in halves]),
        )
        shares = [f"{100 * share:.1f}" for share in (each.found, each.right, each.right_shifted)]
        rows.append([folder, way, len(each.nme), *shares, f"{100 * np.median(each.nme):.2f}"])
    head = [
        "faces",
        "found by",
        "pictures",
        "found, %",
        "below 5 %, %",
        "below 5 % of moved truth, %",
        "median distance, %",
    ]
    return "## First frames of new people\n\n" + tables.table(head, rows)


def folds(
    train: Sequence[Sample], truth: Sequence[TruePicture]
) -> tuple[list[list[Sample]], list[list[TruePicture]]]:
    """Training sets, and for each the pictures of people who are not in it."""
    halves = split_people(train, 2)
    people = [{sample.face.person for sample in half} for half in halves]
    known = set().union(*people)
    # Who is in neither half is judged once.
    other = [[each for each in truth if each.person in own] for own in reversed(people)]
    other[0] += [each for each in truth if each.person not in known]
    return halves, other


def _joined(values: Sequence[int]) -> str:
    return ", ".join(map(str, values))
