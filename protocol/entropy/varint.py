"""Integers of variable length, one to five bytes, and fields that begin with them."""

MAX_VARINT = 2**32 - 1


def encode_varint(value: int) -> bytes:
    """Code `value` >= 0 in groups of seven bits, lowest first; bit 7 marks all but the last."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def decode_varint(data: bytes) -> tuple[int, int]:
    """Value and length of the varint of at most five bytes at the start of `data`.

    Raises `ValueError` if it is incomplete, has a superfluous last byte or exceeds 32 bits.
    """
    value = 0
    for index, byte in enumerate(data[:5]):
        value |= (byte & 0x7F) << 7 * index
        if byte < 0x80:
            if (index and not byte) or value > MAX_VARINT:
                raise ValueError(f"bad number {data[: index + 1].hex()}")
            return value, index + 1
    raise ValueError(f"bad number {data[:5].hex()}")


class FieldReader:
    """Takes fields off the front of bytes; raises `ValueError` where they end too early.

    rest: the bytes that have not been taken.
    """

    def __init__(self, data: bytes) -> None:
        self.rest = bytes(data)

    def take(self, count: int) -> bytes:
        """The next `count` bytes."""
        if len(self.rest) < count:
            raise ValueError(f"{count - len(self.rest)} bytes missing")
        taken, self.rest = self.rest[:count], self.rest[count:]
        return taken

    def byte(self) -> int:
        """The next byte."""
        return self.take(1)[0]

    def varint(self) -> int:
        """The next integer."""
        value, length = decode_varint(self.rest)
        self.rest = self.rest[length:]
        return value
