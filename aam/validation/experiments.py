"""All experiments in a row; each returns its part of the tables."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from aam.search.search import METHODS, SearchOptions
from aam.training.train import TrainingOptions
from aam.training.train import train as train_model
from aam.validation import tables
from aam.validation.contenders import Contender, train_head, train_planar
from aam.validation.first_frames import FirstFrames, TruePicture, first_frames
from aam.validation.model_experiments import mode_counts, specificity
from aam.validation.plots import prediction_plot
from aam.validation.prediction_experiments import Matrix, parameter_curves, pose_curves
from aam.validation.samples import Sample, split_people
from aam.validation.search_experiments import Generalisation, best_possible, generalisation
from aam.validation.search_time import search_time
from aam.validation.units.action_units import recognise, show_faces
from aam.validation.units.expressed_faces import EXPRESSIONS, with_units

Tell = Callable[[str], None]

# Experiments in the order of the tables; those that compare the AAM of the head with the 2D AAM.
PARTS = ("model", "search", "speed", "prediction", "variants", "first-frames", "units")
PARTS_OF_PAIR = frozenset({"model", "search", "speed", "prediction"})
SEED = 1
# Faces of the training set whose displacements are predicted.
DISPLACED_FACES = 80
# Faces of known and of new people on which expressions are drawn to judge by.
EXPRESSED_FACES = 40
DRAWN_INTENSITIES = (0.4, 1.0)
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
) -> Iterator[tuple[str, str]]:
    """Files by name and text as each part is done: a table for each part, and plots.

    train, test: share no person.  truth: for the first frames.
    size: texels a side of the finest level.  parts: of `PARTS`.
    Raises `ValueError` if they share one.
    """
    if {each.face.person for each in train} & {each.face.person for each in test}:
        raise ValueError("test has people of train")
    options = TrainingOptions(size=size)
    pair = train_pair(train, options, tell) if set(parts) & PARTS_OF_PAIR else {}
    for part in parts:
        tell(part)
        match part:
            case "model":
                text = model_part(pair, train, test)
            case "search":
                text = search_part(pair, train, test)
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
                text = unit_part(train, test, size)
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
    modes = {name: mode_counts(each, train) for name, each in pair.items()}
    special = {name: specificity(each, train, SEED) for name, each in pair.items()}
    reach = {name: best_possible(each, test) for name, each in pair.items()}
    rows: list[list[object]] = [
        ["shape, texture, combined modes", "9, 81, 33", _joined(modes["head"]), "31, 106, 53"],
        ["specificity, px^2", "6.28", f"{special['head']:.1f}", "8.66"],
        ["best possible error of the test set, px^2", "-", f"{reach['head'].error:.1f}", "-"],
    ]
    own = [_joined(modes["2D"]), f"{special['2D']:.1f}", f"{reach['2D'].error:.1f}"]
    rows = [[*row, each] for row, each in zip(rows, own, strict=True)]
    head = ["", "thesis, head", "here, head", "thesis, 2D", "here, 2D"]
    return "## Compactness and specificity\n\n" + tables.table(head, rows)


def search_part(pair: dict[str, Contender], train: Sequence[Sample], test: Sequence[Sample]) -> str:
    """Generalisation (Table 3.1)."""
    results: dict[tuple[str, str, str], Generalisation] = {}
    lines = []
    for start, displaced in (("exact", False), ("displaced", True)):
        for method in METHODS:
            for name, contender in pair.items():
                options = SearchOptions(method)
                each = generalisation(contender, test, options, displaced, SEED)
                results[name, method, start] = each
            better = results["head", method, start].better_than(results["2D", method, start])
            lines.append(f"- {start} start, {method}: {100 * better:.1f} %")
    text = f"## Generalisation: {len(test)} pictures of new people\n\n"
    text += "Thesis: exact 49.6 (head) and 89.6 (2D), displaced 66.7 and 145.6.\n\n"
    text += tables.search_table(results)
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


def unit_part(train: Sequence[Sample], test: Sequence[Sample], size: int) -> str:
    """Action units of known and of new people (Tables 3.3, 3.4), in the inside-face frame.

    The training set is joined by one drawn expression of each of its faces.
    """
    random, count = np.random.default_rng(SEED), len(EXPRESSIONS)
    drawn = [
        with_units(each, EXPRESSIONS[random.integers(count)], random.uniform(*DRAWN_INTENSITIES))
        for each in train
    ]
    options = TrainingOptions(size=size, frame="inside", retained=0.97, mirror=False)
    return unit_tables(train_head([*train, *drawn], options), train, test)


def unit_tables(contender: Contender, train: Sequence[Sample], test: Sequence[Sample]) -> str:
    """The tables of `unit_part` for a trained AAM; learned are the faces that are not judged."""
    known = _spread(train, min(EXPRESSED_FACES, len(train) // 2))
    learned = [each for each in train if each not in known]
    shown, *judged = (
        show_faces(contender, each) for each in (learned, known, _spread(test, EXPRESSED_FACES))
    )
    dependent, independent = (recognise(shown, each) for each in judged)
    text = "## Action units\n"
    for name in dependent:
        text += f"\n{name}:\n\n" + tables.unit_table(dependent[name], independent[name])
    return text


def _spread(samples: Sequence[Sample], count: int) -> list[Sample]:
    """So many of the samples, all if there are fewer, spread over them."""
    chosen = np.linspace(0, len(samples) - 1, min(count, len(samples)))
    return [samples[number] for number in chosen.astype(int)]


def _joined(values: Sequence[int]) -> str:
    return ", ".join(map(str, values))
