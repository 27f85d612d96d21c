"""Canonical prefix codes: the lengths alone say what the codes are."""

from collections.abc import Sequence

from protocol.voice.bit_string import BitReader, BitWriter


class PrefixCode:
    """Codes of the symbols 0 to n - 1.

    Shorter codes come first, among those of one length that of the smaller symbol; each is the
    number after the one before, with zeros behind it where it is longer.

    lengths: bits of each symbol's code, at least 1.  Raises `ValueError` unless every sequence of
        bits begins with a code.
    """

    def __init__(self, lengths: Sequence[int]) -> None:
        if sum(1 << (max(lengths) - length) for length in lengths) != 1 << max(lengths):
            raise ValueError(f"no complete prefix code has the lengths {lengths}")
        self._lengths = tuple(lengths)
        self._codes = [0] * len(lengths)
        self._symbols: dict[tuple[int, int], int] = {}  # by length and code
        code = before = 0
        for length, symbol in sorted((length, i) for i, length in enumerate(lengths)):
            code <<= length - before
            self._codes[symbol], self._symbols[length, code] = code, symbol
            code, before = code + 1, length

    def put(self, symbol: int, writer: BitWriter) -> None:
        """Write the code of a symbol."""
        writer.put(self._codes[symbol], self._lengths[symbol])

    def take(self, reader: BitReader) -> int:
        """The symbol whose code comes next.  Raises `ValueError` if it is cut off."""
        length = code = 0
        while (length, code) not in self._symbols:
            length, code = length + 1, code << 1 | reader.take(1)
        return self._symbols[length, code]
