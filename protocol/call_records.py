"""Records of a call file: each packet after its length and before a checksum.

A record is a varint `2 * size + whole`, `size` bytes and a checksum.  `whole` is 0 for a frame
packet whose sequence number follows that of the frame packet before: byte 0 of the packet is left
out then, so that the checksum makes no record longer.  Any other packet stands whole.

The checksum covers the varint and the whole packet, byte 0 included: CRC-8 (polynomial 0x07) for
frame and control packets, CRC-32 (ISO-HDLC, big-endian) for model and layer packets.  Both detect
every change within one byte.  Behind a damaged record a reader goes on at the next place from which
a run of records is in order.
"""

from binascii import crc32
from collections.abc import Iterable, Iterator
from typing import BinaryIO

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.limits import MAX_MODEL_PACKET_BYTES, SEQUENCE_MODULUS
from protocol.packets import PacketKind, is_end, max_packet_bytes, packet_kind

MAX_HEAD_BYTES = 3
# Records that must be in order, one after the other, before a reader trusts a place again.
TRUSTED_RUN = 3
# Frame packets that may be missing before that place, and bytes that are searched for it.
MAX_MISSING = 4
MAX_SEARCH_BYTES = 64 * 1024


class DamagedRecord(ProtocolError):
    """A record whose checksum or length is wrong; reading goes on behind it."""


class TruncatedCall(ProtocolError):
    """The file ends in the middle of a record; all packets before it were good."""

    def __init__(self, place: int, reason: str) -> None:
        super().__init__(f"the call is cut off: byte {place}: {reason}")


class _NoRecord(Exception):
    """There is no record in order at a place; `end`: where it says that it ends."""

    def __init__(self, reason: str, end: int | None = None) -> None:
        super().__init__(reason)
        self.end = end


class RecordWriter:
    """Makes the records of one call, in order."""

    def __init__(self) -> None:
        self._sequence = 0

    def record(self, packet: bytes) -> bytes:
        """One packet as it stands in the file."""
        is_frame = packet_kind(packet) is PacketKind.FRAME
        is_next = is_frame and packet[0] == self._sequence
        if is_frame:
            self._sequence = (packet[0] + 1) % SEQUENCE_MODULUS
        body = packet[is_next:]
        head = encode_varint(2 * len(body) + (not is_next))
        return head + body + _checksum(head, packet)


def serialise_records(packets: Iterable[bytes]) -> bytes:
    """The records of the first packets of a call."""
    writer = RecordWriter()
    return b"".join(map(writer.record, packets))


class RecordReader:
    """Reads the records of one call; holds little more than one of them in memory.

    file: after what comes before its first record, `place` bytes.
    """

    def __init__(self, file: BinaryIO, place: int) -> None:
        self._file, self._place = file, place
        self._ahead = b""
        self._sequence = 0

    @property
    def place(self) -> int:
        """The byte of the file at which the next record begins."""
        return self._place

    def read(self) -> bytes | None:
        """The next packet; None at the end of the file.

        Raises `DamagedRecord`, after which the next call goes on behind the damage, and
        `TruncatedCall` if the file ends inside a record.
        """
        if not self._fill(1):
            return None
        try:
            packet, end = self._parse(0, self._sequence)
        except _NoRecord as damage:
            raise self._skip(damage) from damage
        self._sequence = _sequence_after(packet, self._sequence)
        self._drop(end)
        return packet

    def _parse(self, start: int, sequence: int) -> tuple[bytes, int]:
        """The packet of the record at `start`, whose frame number would be `sequence`; its end."""
        head = self._head(start)
        value, _ = decode_varint(head)
        size, whole = value // 2, value % 2
        if not 1 <= size + (not whole) <= MAX_MODEL_PACKET_BYTES:
            raise _NoRecord(f"record of {size} bytes")
        begin = start + len(head)
        if not whole and 1 + size > max_packet_bytes(PacketKind.FRAME):
            raise _NoRecord(f"frame packet of {size} bytes")
        if not self._fill(begin + size):
            raise _NoRecord(f"record has {len(self._ahead) - begin} bytes of {size}")
        packet = (b"" if whole else bytes([sequence])) + self._ahead[begin : begin + size]
        if len(packet) > max_packet_bytes(packet_kind(packet)):
            raise _NoRecord(f"packet of {len(packet)} bytes is too long for its kind")
        checksum = _checksum(head, packet)
        end = begin + size + len(checksum)
        if not self._fill(end):
            raise _NoRecord("the checksum of a record is missing")
        if self._ahead[end - len(checksum) : end] != checksum:
            raise _NoRecord("the checksum of a record is wrong", end)
        return packet, end

    def _head(self, start: int) -> bytes:
        end = start
        while end == start or self._ahead[end - 1] >= 0x80:
            end += 1
            if end - start > MAX_HEAD_BYTES:
                raise _NoRecord("the length of a record is too large")
            if not self._fill(end):
                raise _NoRecord("in the length of a record")
        head = self._ahead[start:end]
        if len(head) > 1 and not head[-1]:
            raise _NoRecord("the length of a record has a byte too many")
        return head

    def _skip(self, damage: _NoRecord) -> ProtocolError:
        """Go to the next place to be trusted; the error to raise."""
        place = self._place
        self._fill(MAX_SEARCH_BYTES)
        for start in self._candidates(damage.end):
            for missing in range(MAX_MISSING + 1):
                sequence = (self._sequence + missing) % SEQUENCE_MODULUS
                if self._is_trusted(start, sequence):
                    self._sequence = sequence
                    self._drop(start)
                    return DamagedRecord(f"byte {place}: {damage}")
        if damage.end is None:
            self._drop(len(self._ahead))
            return TruncatedCall(place, str(damage))
        # It is the last record.
        self._drop(damage.end)
        return DamagedRecord(f"byte {place}: {damage}")

    def _candidates(self, end: int | None) -> Iterator[int]:
        if end is not None:
            yield end
        yield from range(1, len(self._ahead))

    def _is_trusted(self, start: int, sequence: int) -> bool:
        """Whether a run of records begins at `start`, or the last ones of the call."""
        for _ in range(TRUSTED_RUN):
            try:
                packet, start = self._parse(start, sequence)
            except _NoRecord:
                return False
            if is_end(packet):
                return True
            sequence = _sequence_after(packet, sequence)
        return True

    def _fill(self, count: int) -> bool:
        """Whether there are so many bytes ahead."""
        while len(self._ahead) < count:
            more = self._file.read(count - len(self._ahead))
            if not more:
                return False
            self._ahead += more
        return True

    def _drop(self, count: int) -> None:
        self._ahead = self._ahead[count:]
        self._place += count


def _sequence_after(packet: bytes, before: int) -> int:
    is_frame = packet_kind(packet) is PacketKind.FRAME
    return (packet[0] + 1) % SEQUENCE_MODULUS if is_frame else before


def _checksum(head: bytes, packet: bytes) -> bytes:
    if packet_kind(packet) in (PacketKind.MODEL, PacketKind.LAYER):
        return crc32(packet, crc32(head)).to_bytes(4, "big")
    return bytes([_crc8(head + packet)])


def _crc8_of_byte(value: int) -> int:
    for _ in range(8):
        value = value << 1 ^ (0x107 if value & 0x80 else 0)
    return value


_CRC8 = bytes(_crc8_of_byte(value) for value in range(256))


def _crc8(data: bytes) -> int:
    value = 0
    for byte in data:
        value = _CRC8[value ^ byte]
    return value
