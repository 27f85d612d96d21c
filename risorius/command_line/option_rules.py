"""Options that go together, and which profile a call is coded in where the user leaves it open."""

import argparse
from collections.abc import Mapping

from shared_model.errors import UserError

# What only one of the profiles has a use for, with its usual value.
THESIS_OPTIONS: Mapping[str, object] = {
    "lids": False,
    "detector": "network",
    "tracker": "full",
    "without": frozenset(),
    "normalise": "none",
    "abs": "gauss-newton",
    "refine": True,
}
DEFAULT_OPTIONS: Mapping[str, object] = {
    "bitrate": 800.0,
    "live": False,
    "fps": None,
    "startup_bitrate": None,
}
# What `encode` and `decode` have a use for over a link only, and what a sweep has none for.
ENCODE_LINK_OPTIONS: Mapping[str, object] = {"call": "call", "lossless": False, "wait": 30.0}
DECODE_LINK_OPTIONS: Mapping[str, object] = {"call": "call", "timeout": 0.0}
UNSWEPT_OPTIONS: Mapping[str, object] = {
    **THESIS_OPTIONS,
    **DEFAULT_OPTIONS,
    "model_bytes": None,
    "pace": True,
}


def chosen_profile(arguments: argparse.Namespace) -> str:
    """The profile asked for, or the one that what is asked for needs, or has here.

    Raises `UserError` where an option would be ignored in silence.
    """
    of_thesis = _given(arguments, THESIS_OPTIONS)
    of_default = _given(arguments, DEFAULT_OPTIONS)
    if of_thesis and of_default:
        raise UserError(
            f"{of_thesis[0]} is about the thesis profile, {of_default[0]} about the default one:"
            " they do not go together"
        )
    profile: str | None = arguments.profile
    if profile is None and (of_thesis or of_default):
        profile = "thesis" if of_thesis else "default"
    elif profile is None:
        profile = profile_at_hand()
    wrong = of_default if profile == "thesis" else of_thesis
    if wrong:
        other = "default" if profile == "thesis" else "thesis"
        raise UserError(f"{wrong[0]} is about the {other} profile; add --profile {other}")
    return profile


def refuse(arguments: argparse.Namespace, options: Mapping[str, object], beside: str) -> None:
    """Raise `UserError` if any of the options, by their usual values, is given beside another."""
    for option in _given(arguments, options):
        raise UserError(f"{option} does not go with {beside}; leave out {option}")


def check_startup(arguments: argparse.Namespace) -> None:
    """Raise `UserError` where `--startup-bitrate` leaves nothing for the model."""
    startup: float | None = arguments.startup_bitrate
    if startup is not None and startup <= arguments.bitrate:
        raise UserError(
            f"--startup-bitrate {startup:g} leaves nothing for the model"
            f" beside frames of --bitrate {arguments.bitrate:g}"
        )


def profile_at_hand() -> str:
    """The default profile, or that of the thesis where the landmark networks are missing."""
    from encoder.detection.tflite import NetworkFilesMissing, find_network_folder

    try:
        find_network_folder()
    except NetworkFilesMissing:
        return "thesis"
    return "default"


def _given(arguments: argparse.Namespace, options: Mapping[str, object]) -> list[str]:
    """Those of the options, by their usual values, that the command has and that differ."""
    found = {name: getattr(arguments, name, usual) for name, usual in options.items()}
    given = {name: value for name, value in found.items() if value != options[name]}
    return [
        f"--{'no-' if value is False else ''}{name.replace('_', '-')}"
        for name, value in given.items()
    ]
