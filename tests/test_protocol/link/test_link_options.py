"""Options of a link that cannot be."""

import pytest

from protocol.link.interface import LinkOptions
from shared_model.errors import UserError


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"call": "a/b"}, "call name"),
        ({"call": ""}, "call name"),
        ({"call": "*"}, "call name"),
        ({"call": 64 * "a"}, "call name"),
        ({"call": "é"}, "63 of a-z, A-Z, 0-9"),
        ({"call": ".."}, "no . in front"),
        ({"call": "x"}, "no endpoint"),
        ({"call": "x", "connect": ("sctp/host:7447",)}, "expected HOST:7447"),
        ({"call": "x", "listen": ("tcp/host:65536",)}, "ports go up to 65535"),
        ({"call": "x", "listen": ("tcp/host:" + 5000 * "1",)}, "expected HOST:7447"),
        ({"call": "x", "connect": ("tcp/host:0",)}, "nobody listens on port 0"),
    ],
)
def test_options_are_checked_before_anything_is_opened(
    options: dict[str, object], message: str
) -> None:
    with pytest.raises(UserError, match=message):
        LinkOptions(**options)  # type: ignore[arg-type]
