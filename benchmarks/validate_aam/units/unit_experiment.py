"""The experiment on action units (Tables 3.3 and 3.4)."""

from collections.abc import Mapping, Sequence

import numpy as np

from aam.training.train import TrainingOptions
from benchmarks.validate_aam import tables
from benchmarks.validate_aam.asked import Asked, Part, verdict
from benchmarks.validate_aam.contenders import Contender, train_head
from benchmarks.validate_aam.samples import Sample
from benchmarks.validate_aam.units.action_units import recognise, show_faces
from benchmarks.validate_aam.units.expressed_faces import EXPRESSIONS, is_at_rest, with_units
from benchmarks.validate_aam.units.outcomes import OUTCOMES, Recognition

# Faces of known and of new people on which expressions are drawn to judge by.
EXPRESSED_FACES = 40
DRAWN_INTENSITIES = (0.4, 1.0)
# The classifiers by which known and new people are judged, see `recognise`.
KNOWN_BY, NEW_BY = "SVM less own neutral", "SVM of gradients"


def unit_part(
    train: Sequence[Sample], test: Sequence[Sample], size: int, seed: int, anchors: str = "eyes"
) -> Part:
    """Action units of known and of new people (Tables 3.3, 3.4), in the inside-face frame.

    The training set is joined by one drawn expression of each of its faces.
    anchors: where searches start, see `start_pose`.
    """
    random, count = np.random.default_rng(seed), len(EXPRESSIONS)
    drawn = [
        with_units(each, EXPRESSIONS[random.integers(count)], random.uniform(*DRAWN_INTENSITIES))
        for each in train
    ]
    options = TrainingOptions(
        size=size, frame="inside", retained=0.97, mirror=False, regression=False
    )
    contender = train_head([*train, *drawn], options)
    known, new = (list(filter(is_at_rest, each)) for each in (train, test))
    return unit_tables(contender, known, new, anchors)


def unit_tables(
    contender: Contender, train: Sequence[Sample], test: Sequence[Sample], anchors: str = "eyes"
) -> Part:
    """The tables of `unit_part` for a trained AAM, of faces at rest.

    Known people are those of several pictures; each is judged by up to half of them, and learned by
    the others, by which the own neutral face is known, too.
    """
    known = _spread(half_of_each_person(train), EXPRESSED_FACES)
    judged = {each.face.name for each in known}
    learned = [each for each in train if each.face.name not in judged]
    shown = (
        show_faces(contender, each, anchors)
        for each in (learned, known, _spread(test, EXPRESSED_FACES))
    )
    text = f"## Action units, searches from {anchors}\n\n{len(learned)} faces are learned.\n"
    results = recognise(*shown)
    for name, (dependent, independent) in results.items():
        text += f"\n{name}, known people:\n\n" + tables.unit_table(dependent, tables.THESIS_KNOWN)
        if independent is not None:
            table = tables.unit_table(independent, tables.THESIS_NEW)
            text += f"\n{name}, new people:\n\n" + table
    known_by, new_by = results[KNOWN_BY][0], results[NEW_BY][1]
    asked = [_asked(f"known people, {KNOWN_BY} (Table 3.3)", known_by, tables.THESIS_KNOWN)]
    if new_by is not None:
        asked.append(_asked(f"new people, {NEW_BY} (Table 3.4)", new_by, tables.THESIS_NEW))
    return Part(text, {}, asked)


def _asked(who: str, found: Recognition, thesis: Mapping[str, tuple[int, ...]]) -> Asked:
    """Shares of the outcomes of what is shown against the thesis'."""
    shown, *counts = (sum(each) for each in zip(*thesis.values(), strict=True))
    shares = (tables.thesis_percent(count, shown) for count in counts)
    limits = dict(zip(OUTCOMES, shares, strict=True))
    reached = {name: 100 * found.share(name) for name in OUTCOMES}
    met = {
        "right": reached["right"] >= limits["right"],
        "false": reached["false"] <= limits["false"],
    }
    asked, told = (", ".join(f"{v:.1f}" for v in each.values()) for each in (limits, reached))
    return Asked(f"action units: {', '.join(OUTCOMES)}, %, {who}", asked, told, verdict(met))


def half_of_each_person(samples: Sequence[Sample]) -> list[Sample]:
    """Every other of each person's samples but for the first."""
    seen: dict[str, int] = {}
    chosen = []
    for sample in samples:
        number = seen[sample.face.person] = seen.get(sample.face.person, -1) + 1
        if number % 2:
            chosen.append(sample)
    return chosen


def _spread(samples: Sequence[Sample], count: int) -> list[Sample]:
    """So many of the samples, all if there are fewer, spread over them."""
    chosen = np.linspace(0, len(samples) - 1, min(count, len(samples)))
    return [samples[number] for number in chosen.astype(int)]
