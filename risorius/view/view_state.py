"""What a viewer's page shows and asks for: the actuators as data, a state out of a query."""

from typing import Any
from urllib.parse import parse_qsl

import numpy as np

from risorius.animation.animation_script import GROUPS, AnimationState
from shared_model.anatomy.anthropometry import MEASUREMENTS
from shared_model.anatomy.expressions import DOWN, EMOTIONS, UP
from shared_model.anatomy.muscle_fields import side_names
from shared_model.anatomy.muscle_table import MUSCLES
from shared_model.anatomy.muscles import Muscle
from shared_model.arrays import Array
from shared_model.parameters import EAUS, clip_eau

# Where on the face the page shows a muscle, by its name's first word, or by both where that is not
# enough.
MUSCLE_REGIONS = dict.fromkeys(("frontalis", "lateral", "procerus"), "Brows")
MUSCLE_REGIONS |= dict.fromkeys(("zygomatic", "anguli", "risorius", "levator"), "Mouth")
MUSCLE_REGIONS |= {"nasi": "Nose", "orbicularis oculi": "Eyes", "orbicularis oris": "Mouth"}
MUSCLE_REGIONS |= {"depressor labii": "Mouth", "depressor supercilii": "Brows"}


def state_from_query(query: str) -> AnimationState:
    """The state of a query such as `jaw_drop=0.5&happiness=1&yaw=-20`; all else is at rest.

    Names and ranges are those of animation scripts.  Raises ValueError if one is none of them.
    """
    values = {
        group: {name: limits[0] for name, limits in names.items()}
        for group, names in GROUPS.items()
    }
    for name, text in parse_qsl(query, keep_blank_values=True):
        group = next((group for group, names in GROUPS.items() if name in names), None)
        if group is None:
            raise ValueError(f"nothing is called {name!r}")
        values[group][name] = _number(name, text, GROUPS[group][name])
    eau = np.array(list(values["eau"].values()))
    for emotion in EMOTIONS:
        eau = eau + values["emotion"][emotion.name] * emotion.peak()
    muscles, aau = (np.array(list(values[group].values())) for group in ("muscle", "aau"))
    light = values["light"]
    zoom = values["camera"]["zoom"]
    return AnimationState(
        clip_eau(eau), muscles, aau, values["pose"], light["brightness"], light["side"], zoom
    )


def page_description(width: int, height: int, caller: str | None) -> dict[str, Any]:
    """What the page is made of: its picture's size, who is shown, and every actuator.

    caller: name of the call file, None for the generic head.
    """
    return {
        "width": width,
        "height": height,
        "caller": caller,
        "eaus": [_eau(index) for index in range(len(EAUS))],
        "muscles": [_muscle(muscle) for muscle in MUSCLES],
        "aaus": _aaus(),
        "emotions": [{"name": emotion.name, "eau": _named(emotion.peak())} for emotion in EMOTIONS],
    }


def _eau(index: int) -> dict[str, Any]:
    eau = EAUS[index]
    return {
        "name": eau.name,
        "region": eau.region,
        "low": eau.low,
        "high": eau.high,
        "au": eau.au,
        "works_up": UP[eau.name].works_by,
        "works_down": DOWN[eau.name].works_by if eau.name in DOWN else "",
    }


def _muscle(muscle: Muscle) -> dict[str, Any]:
    """A muscle as the page takes it; sides: names of its contractions, left before right."""
    return {
        "name": muscle.name,
        "region": MUSCLE_REGIONS.get(muscle.name) or MUSCLE_REGIONS[muscle.name.split()[0]],
        "sides": list(side_names(muscle)),
    }


def _aaus() -> list[dict[str, Any]]:
    """Each AAU, its measurement, and the millimetres by which +1 changes it."""
    return [
        {
            "name": measurement.name,
            "measures": "-".join(measurement.ends),
            "mm": round(2 * measurement.deviation_mm, 2),
        }
        for measurement in MEASUREMENTS
    ]


def _named(eau: Array) -> dict[str, float]:
    return {e.name: float(value) for e, value in zip(EAUS, eau, strict=True) if value}


def _number(name: str, text: str, limits: tuple[float, float, float]) -> float:
    _, low, high = limits
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not low <= value <= high:
        raise ValueError(f"{name} is {text!r}, expected a number from {low:g} to {high:g}")
    return value
