"""Frames of Codec2 on the wire, see docs/format.md.

Mode 700C goes as it is.  In mode 1200 what is frequent has the shorter codes.
`assets/train_voice_codes` made them; protocol/data/README.md says from which speech.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from protocol.voice.bit_string import BitReader, BitWriter

# Bits of a frame of 40 ms of each mode, as Codec2 gives it.
CODEC2_BITS = {"700C": 28, "1200": 48}
PITCH_ENERGY_BITS, STAGE_BITS = 8, 9

# Lengths of the codes: of the voicing of four parts of 10 ms, of an index of pitch and energy, and
# of the first of the three stages of the spectrum.
VOICING_LENGTHS = tuple(int(digit, 16) for digit in "4564677455655541")
PITCH_ENERGY_LENGTHS = tuple(
    int(digit, 16)
    for digit in (
        "a999a798a798a9979886a997a899a79999969998999996889899a897a698a999"
        "998689989899969798a7a787a697a998a998b886a698b9a6a88699979999a797"
        "989699999899a788a898a896a686a99799a8a897a698a896a897a9979999a898"
        "9999b798a69899a7a996a9979889a799999699989999a688a998b887a697a899"
    )
)
SPECTRUM_LENGTHS = tuple(
    int(digit, 16)
    for digit in (
        "a99b8a7b7bba98899b9a9a98bbabaaba99878998a9799bb8aa9a9a8aa9999a9a"
        "89989a9abba99cbba88b9bba89ab99aaa8ba9b8a9baa9a9a8b9bb977b9a979aa"
        "8a89a898b8a88b8a9a9988bbaa9aa899aa9c9a79bca9a89b9a9a98b9ba99aa99"
        "aa7baa8a9ba9979a899a9aa8baa9a8aa89989a9aa8a89bcaa899a98ba9aa9b9b"
        "7c99879a98a77a9a99999abb9baaa9a9aa9a8a98bcba989b8a8a9b98bab99899"
        "aa8baa9a9aaa87888bba9ba799a9abcb8a9989a9a8a98baaa998ab7a9baaba89"
        "aaba8a8a8bba8879999a7aa8baaaabbb79a88a8a999788b8998899999aa9aa8b"
        "8aab99aac9a98b8aa9aa9bbb9aba87999a9b9b899ba9a98a8b9baaa8aaab89ba"
    )
)


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


_VOICING, _PITCH_ENERGY = PrefixCode(VOICING_LENGTHS), PrefixCode(PITCH_ENERGY_LENGTHS)
_SPECTRUM = PrefixCode(SPECTRUM_LENGTHS)


@dataclass(frozen=True, slots=True)
class Fields1200:
    """What a frame of Codec2 1200 says.

    voicing: 4 bits, the first 10 ms highest.  pitch_energy: the index of either half.
    spectrum: the index of the first stage.  refinement: those of the other two, 18 bits.
    """

    voicing: int
    pitch_energy: tuple[int, int]
    spectrum: int
    refinement: int


def put_frame(voice: str, frame: bytes, writer: BitWriter) -> None:
    """Write a frame of a mode.  Raises `ValueError` if it is none."""
    bits = CODEC2_BITS[voice]
    value, padding = int.from_bytes(frame), -bits % 8
    if 8 * len(frame) != bits + padding or value % (1 << padding):
        raise ValueError(f"speech frame {frame.hex()} is not of {bits} bits")
    if voice == "700C":
        writer.put(value >> padding, bits)
        return
    fields = fields_1200(frame)
    _VOICING.put(fields.voicing, writer)
    for index in fields.pitch_energy:
        _PITCH_ENERGY.put(index, writer)
    _SPECTRUM.put(fields.spectrum, writer)
    writer.put(fields.refinement, 2 * STAGE_BITS)


def take_frame(voice: str, reader: BitReader) -> bytes:
    """The next frame of a mode.  Raises `ValueError` if it is cut off."""
    if voice == "700C":
        bits = CODEC2_BITS[voice]
        return (reader.take(bits) << -bits % 8).to_bytes((bits + 7) // 8)
    voicing = _VOICING.take(reader)
    indices = _PITCH_ENERGY.take(reader), _PITCH_ENERGY.take(reader)
    spectrum = _SPECTRUM.take(reader)
    return frame_1200(Fields1200(voicing, indices, spectrum, reader.take(2 * STAGE_BITS)))


def fields_1200(frame: bytes) -> Fields1200:
    """The fields of a frame, 6 bytes.  Raises `ValueError` if its spare last bit is 1."""
    reader = BitReader(frame, 0)
    voicing = reader.take(2)
    first = reader.take(PITCH_ENERGY_BITS)
    voicing = voicing << 2 | reader.take(2)
    second = reader.take(PITCH_ENERGY_BITS)
    spectrum, refinement = reader.take(STAGE_BITS), reader.take(2 * STAGE_BITS)
    if reader.take(1):
        raise ValueError(f"the spare bit of speech frame {frame.hex()} is not 0")
    return Fields1200(voicing, (first, second), spectrum, refinement)


def frame_1200(fields: Fields1200) -> bytes:
    """The frame, 6 bytes, of its fields."""
    writer = BitWriter()
    writer.put(fields.voicing >> 2, 2)
    writer.put(fields.pitch_energy[0], PITCH_ENERGY_BITS)
    writer.put(fields.voicing & 3, 2)
    writer.put(fields.pitch_energy[1], PITCH_ENERGY_BITS)
    writer.put(fields.spectrum, STAGE_BITS)
    writer.put(fields.refinement, 2 * STAGE_BITS)
    writer.put(0, 1)
    return writer.to_bytes()
