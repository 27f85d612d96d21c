"""What guards the payloads of a link, by its options."""

import secrets

from protocol.link.interface import LinkOptions, MessageCallback, PacketProtection
from protocol.link.messages import SESSION_BYTES, is_hello
from protocol.link.plain_protection import PlainProtection

STRANGERS = "packets that are not of this call, or were changed on the way, are ignored"
# In a HELLO: after byte 0, the kind, the flags and two nonces.
_SESSION_START = 5


def link_protection(
    options: LinkOptions, is_encoder: bool, say: MessageCallback
) -> PacketProtection:
    """SFrame with the key of an invitation; without a key against change alone.

    say: called with a line, once, when somebody sends what is not of this call.
    """
    key = options.security.key
    if key is None:
        return PlainProtection(secrets.token_bytes(SESSION_BYTES), is_encoder)
    # Only who has a key needs the library.
    from protocol.security.packet_protection import Sender, SFrameProtection

    sender = Sender.ENCODER if is_encoder else Sender.DECODER
    return SFrameProtection(key, options.call, sender, session_in_hello, lambda: say(STRANGERS))


def session_in_hello(data: bytes) -> bytes | None:
    """The session that a HELLO names; None if the payload is none."""
    session = data[_SESSION_START : _SESSION_START + SESSION_BYTES]
    return bytes(session) if is_hello(data) and len(session) == SESSION_BYTES else None
