"""Values that options may have, which go together, and the profile they ask for.

An option is named as on the command line, with underscores: `startup_bitrate`.  Nothing
that needs NumPy is imported at the top: a command line that checks its options starts quickly.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from protocol.limits import VOICES
from shared_model.errors import UserError

Options = Mapping[str, object]
# How an option and its value are written in a message.
Spelling = Callable[[str, object], str]

# Values of other options that one option stands for; each may still be given by itself.
PRESETS: Mapping[str, Options] = {
    "thesis-literal": {
        "profile": "thesis",
        "aam": "builtin",
        "abs": "mirrored-matrix",
        "normalise": "retinex",
    },
}
CHOICES: Mapping[str, tuple[str, ...]] = {
    "preset": tuple(PRESETS),
    "profile": ("default", "thesis"),
    "detector": ("network", "haar"),
    "tracker": ("single", "full"),
    "normalise": ("none", "retinex"),
    "abs": ("gauss-newton", "mirrored", "matrix", "mirrored-matrix"),
    "klt_points": ("first", "visible"),
    "projection": ("perspective", "lowe"),
    "voice": VOICES,
}
# Options that have an effect in one profile only, and their defaults.
THESIS_OPTIONS: Options = {
    "lids": False,
    "texture_modes": 0,
    "detector": "network",
    "aam": None,
    "nose_cascade": None,
    "aam_every_frame": False,
    "aam_feedback": False,
    "tracker": "full",
    "without": frozenset(),
    "normalise": "none",
    "abs": "gauss-newton",
    "klt_points": "first",
    "projection": "perspective",
    "free_focal": False,
    "refine": True,
}
DEFAULT_OPTIONS: Options = {
    "bitrate": 800.0,
    "live": False,
    "low_delay": False,
    "delay": 0.0,
    "fps": None,
    "startup_bitrate": None,
}
# Value of an option -> options that have no effect with it.  `without` is a set of such values.
NO_EFFECT: Mapping[tuple[str, str], tuple[str, ...]] = {
    ("without", "klt"): ("klt_points",),
    ("tracker", "single"): (
        *("without", "normalise", "abs", "refine"),
        *("klt_points", "projection", "free_focal", "aam_feedback"),
    ),
    ("without", "ekf"): ("projection", "free_focal", "aam_feedback"),
    ("without", "abs"): ("normalise", "abs", "refine"),
    ("detector", "haar"): ("lids", "refine"),
    ("detector", "network"): ("nose_cascade",),
}
# Option -> options that have no effect where it is given.
REPLACED: Mapping[str, tuple[str, ...]] = {
    "aam": ("detector",),
    "aam_feedback": ("aam_every_frame",),
    "texture_modes": ("refine",),
}
# Options that say how the model of --aam is used.
OF_MODEL = ("aam_every_frame", "aam_feedback")


@dataclass(frozen=True, slots=True)
class Range:
    """Numbers from `low` to `high`; open: without these two.  unit: of the number."""

    low: float
    high: float
    unit: str
    is_open: bool = False
    is_integer: bool = False

    def __contains__(self, value: float) -> bool:
        inside = self.low < value < self.high if self.is_open else self.low <= value <= self.high
        return inside and (not self.is_integer or value == int(value))

    def __str__(self) -> str:
        if self.is_open:
            return f"above {self.low:g} and below {self.high:g} {self.unit}"
        return f"{self.low:.0f} to {self.high:.0f} {self.unit}"


RANGES: Mapping[str, Range] = {
    "bitrate": Range(0, 1e9, "bits a second", is_open=True),
    "startup_bitrate": Range(0, 1e9, "bits a second", is_open=True),
    "fps": Range(0, 1e9, "frames a second", is_open=True),
    "delay": Range(0, 10, "seconds"),
    "model_bytes": Range(2000, 100_000, "bytes", is_integer=True),
    "max_frames": Range(1, 1e9, "frames", is_integer=True),
    "texture_modes": Range(0, 64, "modes", is_integer=True),
}


def with_preset(options: Options) -> dict[str, object]:
    """The options, and where they do not say otherwise what their preset stands for."""
    preset = options.get("preset")
    expanded = dict(options)
    for name, value in PRESETS[str(preset)].items() if preset is not None else ():
        if options.get(name, THESIS_OPTIONS.get(name)) == THESIS_OPTIONS.get(name):
            expanded[name] = value
    return expanded


def check_value(name: str, value: object) -> None:
    """Raise `ValueError` if the option cannot have this value, which is not None."""
    if name in CHOICES and value not in CHOICES[name]:
        raise ValueError(f"{value} is none of {', '.join(CHOICES[name])}")
    if name in RANGES:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{value} is not a number")
        if value not in RANGES[name]:
            raise ValueError(f"{value:g} is not {RANGES[name]}")


def check_values(options: Options) -> None:
    """Raise `ValueError` for an option that cannot have its value; None: it is not given."""
    for name, value in options.items():
        try:
            if value is not None:
                check_value(name, value)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error


def checked_options(
    options: Options, spelling: Spelling, otherwise: str | None = None
) -> dict[str, Any]:
    """The options of an encoder with what their preset stands for and with their profile: the one
    that they name, or that they need, or `otherwise`.

    options: by name; a missing one has its default.
    otherwise: a profile; None: that which works with what is installed.
    Raises `UserError` if one of the options has no effect with the others.
    """
    options = with_preset(options)
    of_thesis = _given(options, THESIS_OPTIONS, spelling)
    of_default = _given(options, DEFAULT_OPTIONS, spelling)
    if of_thesis and of_default:
        raise UserError(
            f"{of_thesis[0]} is about the thesis profile, {of_default[0]} about the default one:"
            " they do not go together"
        )
    profile = options.get("profile") or ("thesis" if of_thesis else "default" if of_default else "")
    profile = profile or otherwise or available_profile()
    other, misplaced = ("default", of_default) if profile == "thesis" else ("thesis", of_thesis)
    if misplaced:
        asked = spelling("profile", other)
        raise UserError(f"{misplaced[0]} is about the {other} profile; add {asked}")
    _check_effects(options, spelling)
    _check_startup(options, spelling)
    return {**options, "profile": profile}


def check_delay(delay_s: float, is_live: bool) -> None:
    """Raise `UserError` if a call that is not live is to wait."""
    if delay_s and not is_live:
        raise UserError(
            f"--delay {delay_s:g} is about live calls: a recorded source is looked at whole before"
            " it is sent; add --live or leave out --delay"
        )


def available_profile() -> str:
    """The default profile, or that of the thesis if the landmark networks are not installed."""
    from encoder.detection.tflite import NetworkFilesMissing, find_network_folder

    try:
        find_network_folder()
    except NetworkFilesMissing:
        return "thesis"
    return "default"


def reject(options: Options, refused: Options, other: str) -> None:
    """Raise `UserError` if an option of a command line differs from its default in `refused`.

    other: what it does not go with.
    """
    for name, default in refused.items():
        value = options.get(name, default)
        if value != default:
            option = option_typed(name, value)
            raise UserError(f"{option} does not go with {other}; leave out {option}")


def as_typed(name: str, value: object) -> str:
    """An option and its value as on a command line."""
    option = option_typed(name, value)
    if isinstance(value, bool):
        return option
    if isinstance(value, Collection) and not isinstance(value, str):
        return f"{option} {','.join(sorted(map(str, value)))}"
    return f"{option} {value:g}" if isinstance(value, float) else f"{option} {value}"


def option_typed(name: str, value: object) -> str:
    """An option as on a command line, without its value."""
    return f"--{'no-' if value is False else ''}{name.replace('_', '-')}"


def _check_effects(options: Options, spelling: Spelling) -> None:
    replaced = {other for name, others in REPLACED.items() if options.get(name) for other in others}
    for (name, value), others in NO_EFFECT.items():
        given = None if name in replaced else options.get(name)
        is_part = isinstance(given, Collection) and not isinstance(given, str) and value in given
        if given == value or is_part:
            _check_idle(options, name, others, spelling)
    check_model_is_named(options, spelling)
    for name, others in REPLACED.items():
        if options.get(name):
            _check_idle(options, name, others, spelling)


def check_model_is_named(options: Options, spelling: Spelling) -> None:
    """Raise `UserError` if an option of `OF_MODEL` is given without a model."""
    for name in OF_MODEL:
        if options.get("aam") is None and options.get(name):
            raise UserError(f"{spelling(name, True)} is about the model of --aam; add --aam MODEL")


def _check_idle(options: Options, name: str, others: Collection[str], spelling: Spelling) -> None:
    """Raise `UserError` if one of the other options is given, which have no effect with `name`."""
    defaults = {other: THESIS_OPTIONS[other] for other in others}
    if idle := _given(options, defaults, spelling):
        raise UserError(
            f"{idle[0]} has no effect with {spelling(name, options.get(name))}; leave it out"
        )


def _check_startup(options: Options, spelling: Spelling) -> None:
    startup, bitrate = options.get("startup_bitrate"), options.get("bitrate", 800.0)
    if not isinstance(startup, int | float) or not isinstance(bitrate, int | float):
        return
    if startup <= bitrate:
        raise UserError(
            f"{spelling('startup_bitrate', startup)} leaves nothing for the model in addition to"
            f" frames of {spelling('bitrate', bitrate)}"
        )


def _given(options: Options, defaults: Options, spelling: Spelling) -> list[str]:
    """The options that differ from their defaults."""
    given = {name: options.get(name, default) for name, default in defaults.items()}
    return [spelling(name, value) for name, value in given.items() if value != defaults[name]]
