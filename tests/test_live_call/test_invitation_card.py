"""What an end that waits hands over."""

import re

import cv2
import numpy as np
import pytest

from protocol.endpoint import parse_endpoint
from risorius.live_call.invitation_card import card, command_line, watch_address

pytest.importorskip("segno", reason="needs segno: pip install '.[call]'")

KEY = bytes(range(16))
# A path of an SVG: where it begins, and steps to go on, drawn and not drawn.
STEPS = re.compile(r"([Mmh])(-?[\d.]+)(?: (-?[\d.]+))?")


def scanned(svg: str) -> str:
    """What the QR code says that an SVG draws row by row."""
    side, path = re.findall(r'viewBox="0 0 (\d+) .* d="([^"]*)', svg)[0]
    picture, x, y = np.full((int(side), int(side)), 255, np.uint8), 0.0, 0.0
    for step, across, down in STEPS.findall(path):
        if step == "h":
            picture[int(y), int(x) : int(x + float(across))] = 0
        x, y = x + float(across), y + float(down or 0)
    return cv2.QRCodeDetector().detectAndDecode(np.kron(picture, np.ones((8, 8), np.uint8)))[0]


@pytest.mark.parametrize(
    ("listen", "address"), [("192.0.2.7:7447", "192.0.2.7:7447"), ("udp/[::1]:9", "[::1]:9")]
)
def test_the_command_names_where_this_end_listens(listen: str, address: str) -> None:
    line = command_line(parse_endpoint(listen), "anna", is_insecure=False)
    assert line == f"risorius call {address} --call anna"


def test_the_code_says_the_same_as_the_line() -> None:
    line = "risorius call 192.0.2.7:7447 --call anna"
    shown = card(line)
    assert shown["text"] == line and shown["watch"] == ""
    assert scanned(shown["svg"]) == line


@pytest.mark.parametrize(
    ("listen", "key", "address"),
    [
        ("192.0.2.7:7447", None, "http://192.0.2.7:8080/anna-a"),
        ("udp/[::1]:9", KEY, "http://[::1]:8080/anna-a#000G-40R4-0M30-E209-185G-R38E-1W0H"),
    ],
)
def test_a_phone_watches_where_this_end_listens(
    listen: str, key: bytes | None, address: str
) -> None:
    watch = watch_address(parse_endpoint(listen), 8080, "anna-a", key)
    assert watch == address
    line = "risorius call 192.0.2.7:7447 --call anna"
    shown = card(line, watch)
    assert shown["text"] == line and shown["watch"] == address
    assert scanned(shown["svg"]) == address


def test_an_end_that_listens_everywhere_names_an_address_or_nothing() -> None:
    line = command_line(parse_endpoint(":7447"), "anna", is_insecure=True)
    assert line is None or ("0.0.0.0" not in line and line.endswith("--insecure"))
