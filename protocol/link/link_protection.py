"""What guards the payloads of a link: keys, or a checksum of two bytes.

The checksum also tells one session from another.
"""

import secrets
from binascii import crc_hqx

from protocol.limits import SESSION_BYTES
from protocol.link.interface import LinkOptions, MessageCallback, PacketProtection
from protocol.link.messages import is_hello, session_in_hello
from protocol.security.packet_protection import Sender, SFrameProtection

STRANGERS = "packets that are not of this call, or were changed on the way, are ignored"
CHECKSUM_BYTES = 2
_INITIAL = 0xFFFF


def link_protection(
    options: LinkOptions, is_encoder: bool, say: MessageCallback
) -> PacketProtection:
    """SFrame with the key of an invitation; without a key against change alone.

    say: called with a line, once, when somebody sends what is not of this call.
    """
    key = options.security.key
    if key is None:
        return PlainProtection(secrets.token_bytes(SESSION_BYTES), is_encoder)
    sender = Sender.ENCODER if is_encoder else Sender.DECODER
    return SFrameProtection(key, options.call, sender, session_in_hello, lambda: say(STRANGERS))


class PlainProtection:
    """A `PacketProtection` without keys: CRC-16 (polynomial 0x1021, initial value 0xFFFF).

    The checksum covers the data, and before them the session of the encoder; that of a HELLO, which
    tells the session, the data alone.  It detects every change within two bytes.
    session: of this end.  is_encoder: whether it is the encoder's.
    """

    def __init__(self, session: bytes, is_encoder: bool) -> None:
        self._session = session
        self._encoder: bytes | None = session if is_encoder else None
        self._is_encoder = is_encoder

    @property
    def session(self) -> bytes:
        """See `PacketProtection`."""
        return self._session

    def protect(self, data: bytes) -> bytes:
        """`data` and its checksum."""
        return data + self._checksum(data)

    def unprotect(self, data: bytes) -> bytes | None:
        """The data without the checksum; None if that is wrong."""
        body, checksum = data[:-CHECKSUM_BYTES], data[-CHECKSUM_BYTES:]
        return bytes(body) if body and self._checksum(body) == checksum else None

    def on_peer(self, session: bytes) -> None:
        """See `PacketProtection`; a decoder takes the session of its encoder over."""
        if not self._is_encoder:
            self._encoder = session

    def _checksum(self, data: bytes) -> bytes:
        known = b"" if is_hello(data) else self._encoder or b""
        return crc_hqx(data, crc_hqx(known, _INITIAL)).to_bytes(CHECKSUM_BYTES, "big")
