"""`risorius call`: two people see and hear each other, in a browser."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from encoder.option_rules import CHOICES
from protocol.limits import USUAL_VOICE
from protocol.link.endpoints import check_listening
from risorius.command_line.argument_types import bitrate, port
from risorius.command_line.parser import add_command
from risorius.command_line.progress import say, warn
from risorius.live_call.call_place import add_place, read_place
from risorius.live_call.loading import start_loading
from risorius.live_call.messages import BROWSER, CAMERA_SOUND, OwnMedia
from shared_model.errors import UserError

if TYPE_CHECKING:
    from risorius.command_line.parser import Commands
    from risorius.live_call.live_call import CallOptions
    from shared_model.arrays import Picture

NO_MICROPHONE = "off"


def add_call(added: "Commands") -> None:
    """`risorius call`."""
    parser = add_command(
        added,
        "call",
        "call somebody: picture and sound both ways, on a page of this host",
        "One end listens and prints an invitation, the other one is given it.  The page opens in\n"
        "the browser, which gives camera and microphone.  Encrypted from end to end.",
        "  risorius call --listen :7447\n"
        "  risorius call risorius://192.0.2.7:7447/anna#K7Q2-8MDX-0V4R-T9NB-ZZ1C-5GHW-P3JE\n"
        "  risorius call --listen :7447 --camera me.mp4\n"
        "  risorius call --listen :7447 --share 8080    # a phone watches, without installing\n",
    )
    add_place(parser)
    _add_devices(parser)
    _add_coding(parser)
    _add_page(parser)
    parser.set_defaults(run=run_call)


def _add_devices(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--camera",
        default=BROWSER,
        metavar="CAMERA",
        help="browser, or a number or URL of a camera, or a video file, which is repeated"
        " (default: %(default)s)",
    )
    parser.add_argument(
        "--microphone",
        metavar="NAME",
        help="browser, default or another microphone of this host, or off (default: that of the"
        " browser, or the sound of the file, with the camera)",
    )


def _add_coding(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--voice",
        choices=CHOICES["voice"],
        help=f"codec of the voice (default: {USUAL_VOICE} where it is installed)",
    )
    parser.add_argument(
        "--bitrate",
        type=bitrate,
        default=800.0,
        metavar="BPS",
        help="bits a second of the face (default: %(default)g)",
    )
    parser.add_argument(
        "--low-delay",
        action="store_true",
        help="packets of four pictures instead of eight",
    )


def _add_page(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--name", default="", metavar="NAME", help="your name, as the other end shows it"
    )
    parser.add_argument(
        "--face",
        metavar="OTHER",
        help="image or call file of a person who is seen instead of you when the page asks for it;"
        " generic: a drawn head.  The other end gets no picture of you meanwhile",
    )
    parser.add_argument(
        "--face-on", action="store_true", help="with --face: from the beginning of the call"
    )
    parser.add_argument(
        "--folder",
        type=Path,
        default=Path("."),
        metavar="DIR",
        help="where recordings go (default: %(default)s)",
    )
    parser.add_argument(
        "--port", type=port, default=0, metavar="N", help="TCP port of the page; 0: any free one"
    )
    parser.add_argument(
        "--share",
        type=port,
        metavar="PORT",
        help="with --listen: let browsers elsewhere watch you, at an address whose QR code the page"
        " shows; a phone that scans it watches.  0: any free port",
    )


def run_call(arguments: argparse.Namespace) -> int:
    """`risorius call`: hanging up is its normal end."""
    start_loading()
    from risorius.live_call.live_call import run_call as hold

    def announce(address: str) -> None:
        say(f"call: the page is at {address}")

    hold(_options(arguments), announce, lambda news: say(f"call: {news}"))
    return 0


def _options(arguments: argparse.Namespace) -> "CallOptions":
    from risorius.live_call.devices import check_devices
    from risorius.live_call.live_call import CallOptions
    from risorius.page.access import check_port

    face = _other_face(arguments)
    if not arguments.folder.is_dir():
        raise UserError(f"there is no folder {arguments.folder}")
    check_port(arguments.port)
    if arguments.share is not None and arguments.listen is None:
        raise UserError("--share needs --listen: who connects is reached by nobody else")
    check_listening(filter(None, [arguments.listen]))
    microphone = _microphone(arguments)
    voice = _voice(arguments, microphone)
    check_devices(arguments.camera, microphone, voice)
    link, invitation = read_place(arguments)
    return CallOptions(
        link=link,
        invitation=invitation,
        media=OwnMedia(
            arguments.camera,
            microphone,
            voice,
            arguments.bitrate,
            arguments.low_delay,
            face,
            arguments.face_on,
        ),
        port=arguments.port,
        folder=arguments.folder,
        person=arguments.name,
        share=arguments.share,
    )


def _other_face(arguments: argparse.Namespace) -> "Picture | None":
    if arguments.face is None:
        if arguments.face_on:
            raise UserError("--face-on needs --face OTHER")
        return None
    from risorius.face_picture import face_picture

    return face_picture(arguments.face)


def _microphone(arguments: argparse.Namespace) -> str | None:
    from encoder.sound.sound_file import has_sound

    asked: str | None = arguments.microphone
    if asked is not None:
        return None if asked == NO_MICROPHONE else asked
    if arguments.camera == BROWSER:
        return BROWSER
    return CAMERA_SOUND if has_sound(Path(arguments.camera)) else None


def _voice(arguments: argparse.Namespace, microphone: str | None) -> str:
    """The codec of the voice, one of `VOICES`."""
    from encoder.sound.speech_encoder import voice_is_installed

    if arguments.voice is not None:
        return str(arguments.voice)
    if microphone is None:
        return "off"
    if voice_is_installed(USUAL_VOICE):
        return USUAL_VOICE
    warn(["there is no sound: pip install '.[voice]'"])
    return "off"
