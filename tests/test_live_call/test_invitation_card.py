"""What an end that waits hands over."""

import cv2
import numpy as np
import pytest

from protocol.endpoint import parse_endpoint
from risorius.live_call.invitation_card import card, command_line

segno = pytest.importorskip("segno", reason="needs segno: pip install '.[call]'")


@pytest.mark.parametrize(
    ("listen", "address"), [("192.0.2.7:7447", "192.0.2.7:7447"), ("udp/[::1]:9", "[::1]:9")]
)
def test_the_command_names_where_this_end_listens(listen: str, address: str) -> None:
    line = command_line(parse_endpoint(listen), "anna", is_insecure=False)
    assert line == f"risorius call {address} --call anna"


def test_the_code_says_the_same_as_the_line() -> None:
    line = "risorius call 192.0.2.7:7447 --call anna"
    shown = card(line)
    assert shown["text"] == line and shown["svg"].startswith("<svg")
    matrix = np.array([list(row) for row in segno.make(line, error="m").matrix_iter(border=4)])
    picture = np.kron(255 * (1 - matrix), np.ones((8, 8))).astype(np.uint8)
    assert cv2.QRCodeDetector().detectAndDecode(picture)[0] == line


def test_an_end_that_listens_everywhere_names_an_address_or_nothing() -> None:
    line = command_line(parse_endpoint(":7447"), "anna", is_insecure=True)
    assert line is None or ("0.0.0.0" not in line and line.endswith("--insecure"))
