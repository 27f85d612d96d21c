"""The options of the commands that send and draw calls, by what they are about."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from encoder.option_rules import CHOICES, DEFAULT_OPTIONS, THESIS_OPTIONS
from risorius.command_line.argument_types import (
    bitrate,
    count,
    delay,
    frame_rate,
    mode_count,
    model_bytes,
    parts,
    port,
    seconds,
)

SOURCE_HELP = (
    "video file, image pattern (frame_%%04d.png), camera index, URL (rtsp://...)"
    " or -: standard input"
)


def add_option(parser: argparse.ArgumentParser, option: str, help: str, **named: Any) -> None:
    """Add an option; values to choose from, and the default, are those that its rules name.

    named: as of `add_argument`.
    """
    name = option.removeprefix("--").replace("-", "_")
    if name in CHOICES:
        named["choices"] = CHOICES[name]
    default = {**THESIS_OPTIONS, **DEFAULT_OPTIONS}.get(name)
    parser.add_argument(option, help=help, default=default, **named)


def add_coding(parser: argparse.ArgumentParser) -> None:
    """What is coded, at what rate and how large: of `encode` and `bench`."""
    add = partial(add_option, parser)
    _add_rates(parser)
    add(
        "--live",
        action="store_true",
        help="default profile: encode a file in one pass, as if its frames came from a camera,"
        " instead of two",
    )
    add(
        "--delay",
        type=delay,
        metavar="S",
        help="live, default profile: send each frame S seconds after it was seen, 0 to 10, with a"
        " model that has been learned from those after it as well (default: %(default)g)",
    )
    add(
        "--startup-bitrate",
        type=bitrate,
        metavar="BPS",
        help="default profile: send the model in layers, a first one of 2 kB and the others between"
        " the frames, so that all packets together keep to BPS, above --bitrate; a link is then"
        " not measured first, and a live call with --wait makes its first layer while nobody has"
        " come (default: whole, at once; over a thin link as it was measured)",
    )
    parser.add_argument(
        "--model-bytes",
        type=model_bytes,
        metavar="N",
        help="about as large the model packet shall be, 2000 to 100000 (default: 16000 thesis,"
        " 12000 default, more above 1200 bit/s: 31000 at 5000)",
    )
    _add_thesis_coding(parser)
    parser.add_argument(
        "--max-frames", type=count, metavar="N", help="stop after N frames of the source"
    )


def _add_thesis_coding(parser: argparse.ArgumentParser) -> None:
    add = partial(add_option, parser)
    add(
        "--preset",
        help="thesis-literal: the thesis profile with what the thesis has and no network: --aam"
        " builtin --abs mirrored-matrix --normalise retinex",
    )
    add(
        "--lids",
        action="store_true",
        help="thesis profile: also send how far each lid is closed, two values of 8 bits: 960"
        " bits a second instead of 800",
    )
    add(
        "--texture-modes",
        type=mode_count,
        metavar="N",
        help="thesis profile, recorded sources: besides pose and actuators send the coefficients of"
        " up to N modes of the person's texture, learned from the whole recording, at the same 800"
        " bits a second (default: one texture)",
    )
    add(
        "--refine",
        action=argparse.BooleanOptionalAction,
        help="thesis profile: adjust shape and focal length of all but small faces to the first"
        " seconds and send them as updates of some 320 bytes (default: yes)",
    )
    add(
        "--detector",
        help="thesis profile: landmark network (default), or the thesis' Viola-Jones",
    )
    add_statistical_model(parser, "thesis profile: ")
    add(
        "--aam-every-frame",
        action="store_true",
        help="thesis profile: search the model in every frame and give the filter its landmarks and"
        " actuators, not in the first face and lost ones alone",
    )
    add(
        "--nose-cascade",
        metavar="XML",
        help="thesis profile: Viola-Jones finds the nose as well, by this cascade classifier (none"
        " comes along), instead of placing it by the proportions of a face",
    )
    _add_filter(parser)


def add_statistical_model(parser: argparse.ArgumentParser, where: str) -> None:
    """Landmarks by a statistical model.  where: said before the help."""
    add = partial(add_option, parser)
    add(
        "--aam",
        metavar="MODEL",
        help=f"{where}no landmark network: the face is found by Viola-Jones and by a model of"
        " many faces: the file (.npz) that `risorius train` has made, or builtin: the one that"
        " comes along",
    )
    add(
        "--aam-feedback",
        action="store_true",
        help=f"{where}the model also measures the actuators of every frame, by its parameters c"
        " from where the Kalman filter has them, and the filter takes them (thesis 5.2)",
    )


def add_tracking(parser: argparse.ArgumentParser) -> None:
    """How the thesis profile follows the face."""
    add = partial(add_option, parser)
    add(
        "--tracker",
        help="thesis profile: landmarks of each frame by itself, or KLT, filter and the fit of the"
        " person's own texture as well (default: %(default)s)",
    )
    add(
        "--without",
        type=parts,
        metavar="PARTS",
        help="thesis profile: leave parts out of the full tracker, to measure: some of"
        " network,klt,ekf,abs",
    )
    add(
        "--normalise",
        help="thesis profile: what the full tracker fits its texture to: the luma, or retinex and"
        " histogram equalisation of it (default: %(default)s)",
    )
    add(
        "--abs",
        help="thesis profile: how that fit steps: by each picture's gradient, the same with the"
        " visible half of a turned face mirrored, by the thesis' prediction matrix, or by that with"
        " the half mirrored (default: %(default)s)",
    )
    add(
        "--klt-points",
        help="thesis profile: the points that KLT tracks: features of the first frame, or of any"
        " in which they become visible as the head turns (default: %(default)s)",
    )


def _add_filter(parser: argparse.ArgumentParser) -> None:
    """The Kalman filter of the thesis profile."""
    add = partial(add_option, parser)
    add(
        "--projection",
        help="thesis profile: how the filter projects points: as a pinhole camera does, or by"
        " Lowe's equation, as in the thesis (default: %(default)s)",
    )
    add(
        "--free-focal",
        action="store_true",
        help="thesis profile: the filter estimates the focal length as well, as in the thesis,"
        " instead of holding that of the first frame",
    )


def add_sound(parser: argparse.ArgumentParser) -> None:
    """The voice of a call."""
    add = partial(add_option, parser)
    add(
        "--voice",
        help="code the source's first sound track by Codec2 at 1200 or 700 bits a second, or by"
        " Opus at 6000, beside --bitrate; silence takes next to nothing (default: 1200 where the"
        " source has sound and the codec is installed)",
    )


def add_transport(parser: argparse.ArgumentParser) -> None:
    """When and how packets go out."""
    add = partial(add_option, parser)
    add(
        "--low-delay",
        action="store_true",
        help="default profile: packets of four frames instead of eight, which halves the delay of a"
        " call and takes from its quality",
    )
    parser.add_argument(
        "--pace",
        action=argparse.BooleanOptionalAction,
        help="send at the source's own rate (default: over a link yes, into a file no)",
    )
    parser.add_argument(
        "--lossless",
        action="store_true",
        help="over a link, drop no packet, however late it comes: to measure, not to talk",
    )
    parser.add_argument(
        "--wait",
        type=seconds,
        default=30.0,
        metavar="S",
        help="over a link, wait this long for a decoder, and to connect; 0: start at once when"
        " connected, within 10 seconds (default: %(default)g)",
    )
    parser.add_argument(
        "--look-for-face",
        type=seconds,
        default=10.0,
        metavar="S",
        help="say so when there is no face in the first S seconds (default: %(default)g)",
    )


def add_comparison(parser: argparse.ArgumentParser) -> None:
    """Who is drawn, and against what it is measured."""
    likeness = parser.add_mutually_exclusive_group()
    likeness.add_argument(
        "--face",
        type=Path,
        metavar="OTHER",
        help="draw the person of this call file instead, moved by the call's stream",
    )
    likeness.add_argument(
        "--source", metavar="VIDEO", help="the original: report PSNR against it (thesis eq. 6.1)"
    )


def add_timeout(parser: argparse.ArgumentParser) -> None:
    """How long a decoder waits."""
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=0.0,
        metavar="S",
        help="over a link, give up after S seconds without a picture, or to connect to; 0: wait for"
        " pictures as long as it takes, and 10 seconds to connect (default: 0)",
    )


def add_view(parser: argparse.ArgumentParser, what: str) -> None:
    """A page that shows the call.  what: whose face it shows."""
    parser.add_argument(
        "--view",
        action="store_true",
        help=f"show {what} on a page of this host while the call goes on",
    )
    parser.add_argument(
        "--port", type=port, default=0, metavar="N", help="TCP port of that page; 0: any free one"
    )


def add_reporting(parser: argparse.ArgumentParser) -> None:
    """What the command says about the run."""
    parser.add_argument("--report", type=Path, metavar="FILE", help="write the figures as JSON")
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress, no summary")


def _add_rates(parser: argparse.ArgumentParser) -> None:
    add = partial(add_option, parser)
    add(
        "--profile",
        help="default: every frame, with the person's own appearance, entropy-coded; thesis: ten"
        " values of 8 bits, ten times a second (default: default, unless an option of the thesis"
        " profile is given or the landmark networks are missing)",
    )
    add(
        "--bitrate",
        type=bitrate,
        metavar="BPS",
        help="default profile: bits a second of frame packets with their heads and their lengths in"
        " a call file, more than 0; from 1200 on a part is for what the model does not"
        " show, and the model grows (default: %(default)g)",
    )
    add(
        "--fps",
        type=frame_rate,
        metavar="N",
        help="default profile: code about N frames a second, more than 0, the nearest that is every"
        " k-th of the source's; the decoder interpolates those between (default: every frame)",
    )
