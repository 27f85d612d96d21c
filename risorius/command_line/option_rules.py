"""Options of the command line that do not go with others."""

import argparse
from collections.abc import Collection, Mapping

from encoder.option_rules import DEFAULT_OPTIONS, THESIS_OPTIONS, Options, chosen_profile
from shared_model.errors import UserError

# Options with an effect over a link only, and options without one in a sweep, and their defaults.
_LINK_OPTIONS: Options = {"insecure": False, "keys": None}
ENCODE_LINK_OPTIONS: Options = {**_LINK_OPTIONS, "lossless": False, "wait": 30.0}
DECODE_LINK_OPTIONS: Options = {**_LINK_OPTIONS, "timeout": 0.0}
OPTIONS_NOT_FOR_SWEEP: Options = {
    **THESIS_OPTIONS,
    **{name: default for name, default in DEFAULT_OPTIONS.items() if name != "live"},
    "model_bytes": None,
    "pace": True,
    "busy": 0,
    "cores": None,
}
# The same where clips are tracked and not sent.
_OF_TRACKS = ("aam", "aam_feedback")
OPTIONS_NOT_FOR_TRACKS: Options = {
    **{name: default for name, default in THESIS_OPTIONS.items() if name not in _OF_TRACKS},
    **DEFAULT_OPTIONS,
    **{name: None for name in ("profile", "preset", "sweep", "against", "scheduler")},
    "model_bytes": None,
    "timings": False,
    "jobs": 1,
    "pace": True,
    "busy": 0,
    "cores": None,
}


def profile_of(arguments: argparse.Namespace) -> str:
    """The profile that the arguments ask for, see `chosen_profile`.  Raises `UserError`."""
    return chosen_profile(vars(arguments), as_typed)


def reject(arguments: argparse.Namespace, options: Mapping[str, object], other: str) -> None:
    """Raise `UserError` if an argument differs from its default in `options`.

    other: what it does not go with.
    """
    for name, default in options.items():
        value = getattr(arguments, name, default)
        if value != default:
            option = _option(name, value)
            raise UserError(f"{option} does not go with {other}; leave out {option}")


def as_typed(name: str, value: object) -> str:
    """An option and its value as on a command line."""
    option = _option(name, value)
    if isinstance(value, bool):
        return option
    if isinstance(value, Collection) and not isinstance(value, str):
        return f"{option} {','.join(sorted(map(str, value)))}"
    return f"{option} {value:g}" if isinstance(value, float) else f"{option} {value}"


def _option(name: str, value: object) -> str:
    return f"--{'no-' if value is False else ''}{name.replace('_', '-')}"
