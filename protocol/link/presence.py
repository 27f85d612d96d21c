"""Who is there: the keys of a call, and the question and answer on them.

The encoder publishes on d/CALL, its decoders on u/CALL; a page that a relay serves on u/CALL/PAGE,
and what is for it alone is published on d/CALL/PAGE.  A question and its answer are one byte,
the role, and the name of the call.
"""

from protocol.limits import CALL_NAME
from protocol.link.messages import Role

WHO_KEY = "w"
MAX_PRESENCE_BYTES = 256


def call_keys(call: str, is_encoder: bool) -> tuple[str, str]:
    """The keys that an end publishes on and subscribes to."""
    down, up = f"d/{call}", f"u/{call}"
    return (down, up) if is_encoder else (up, down)


def page_key(key: str, page: str) -> str:
    """What stands for a key of a call for one page, or for each of them: *."""
    return f"{key}/{page}"


def page_of(key: str) -> str:
    """The page that a key of a call is for; "" if it is for all."""
    parts = key.split("/", 2)
    return parts[2] if len(parts) > 2 else ""


def short_key(key: str) -> str:
    """What stands for a key of a call where it is the only one, straight from end to end."""
    return key.partition("/")[0]


def serialise_presence(role: Role, call: str) -> bytes:
    """Who asks or answers; a relay has no call."""
    return bytes([role]) + call.encode()


def parse_presence(data: bytes) -> tuple[Role, str] | None:
    """Role and call; None if the bytes do not say them."""
    text = data[1:].decode("utf-8", "replace")
    if not 0 < len(data) <= MAX_PRESENCE_BYTES or data[0] not in list(Role):
        return None
    if bool(text) == (data[0] == Role.RELAY) or (text and not CALL_NAME.fullmatch(text)):
        return None
    return Role(data[0]), text
