"""The one error of bytes from outside."""


class ProtocolError(Exception):
    """Bytes that are not a valid packet or call; the message says what is wrong and where."""
