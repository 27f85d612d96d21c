"""Records of a call file: the length of a packet, the packet, a checksum.

A record is a varint `2 * size + whole`, `size` bytes and a checksum.  `whole` is 0 for a frame
packet whose sequence number follows that of the frame packet before: its byte 0 is omitted, so the
checksum makes no record longer.  Any other packet is stored completely.

The checksum covers the varint and the complete packet, byte 0 included: CRC-8 (polynomial 0x07) for
frame and control packets, CRC-32 (ISO-HDLC, big-endian) for model and layer packets.  Both detect
every change within one byte.  After a damaged record a reader resynchronises at the next offset
from which several records are valid.
"""

from binascii import crc32
from collections.abc import Iterable, Iterator
from typing import BinaryIO

from protocol.entropy.varint import decode_varint, encode_varint
from protocol.errors import ProtocolError
from protocol.limits import MAX_MODEL_PACKET_BYTES, SEQUENCE_MODULUS
from protocol.packets import PacketKind, is_end, max_packet_bytes, packet_kind

MAX_HEAD_BYTES = 3
# Successive records that must be valid at the offset where a reader resynchronises.
TRUSTED_RUN = 3
# Frame packets that may be missing before that offset, and bytes that are searched for it.
MAX_MISSING = 4
MAX_SEARCH_BYTES = 64 * 1024


class DamagedRecord(ProtocolError):
    """A record whose checksum or length is wrong; reading continues after it."""


class TruncatedCall(ProtocolError):
    """The file ends within a record; all packets before it are valid."""

    def __init__(self, offset: int, reason: str) -> None:
        super().__init__(f"the call is cut off: byte {offset}: {reason}")


class _InvalidRecord(Exception):
    """There is no valid record at an offset.  end: the end of the record by its length."""

    def __init__(self, reason: str, end: int | None = None) -> None:
        super().__init__(reason)
        self.end = end


class RecordWriter:
    """Makes the records of one call, in order."""

    def __init__(self) -> None:
        self._sequence = 0

    def record(self, packet: bytes) -> bytes:
        """The record of the next packet."""
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
    """Reads the records of one call; holds little more than one record in memory.

    file: open at its first record.
    offset: of the first record in the file, bytes.
    """

    def __init__(self, file: BinaryIO, offset: int) -> None:
        self._file, self._offset = file, offset
        self._buffer = b""
        self._sequence = 0

    @property
    def offset(self) -> int:
        """Offset of the next record in the file, bytes."""
        return self._offset

    def read(self) -> bytes | None:
        """The next packet; None at the end of the file.

        Raises `DamagedRecord`, after which the next call continues after the damage, and
        `TruncatedCall` if the file ends within a record.
        """
        if not self._fill(1):
            return None
        try:
            packet, end = self._parse(0, self._sequence)
        except _InvalidRecord as damage:
            raise self._skip(damage) from damage
        self._sequence = _sequence_after(packet, self._sequence)
        self._drop(end)
        return packet

    def _parse(self, start: int, sequence: int) -> tuple[bytes, int]:
        """The packet of the record at `start`, and the end of the record.

        sequence: the sequence number of a frame packet without byte 0.
        """
        head = self._head(start)
        value, _ = decode_varint(head)
        size, whole = value // 2, value % 2
        if not 1 <= size + (not whole) <= MAX_MODEL_PACKET_BYTES:
            raise _InvalidRecord(f"record of {size} bytes")
        begin = start + len(head)
        if not whole and 1 + size > max_packet_bytes(PacketKind.FRAME):
            raise _InvalidRecord(f"frame packet of {size} bytes")
        if not self._fill(begin + size):
            raise _InvalidRecord(f"record has {len(self._buffer) - begin} bytes of {size}")
        packet = (b"" if whole else bytes([sequence])) + self._buffer[begin : begin + size]
        if len(packet) > max_packet_bytes(packet_kind(packet)):
            raise _InvalidRecord(f"packet of {len(packet)} bytes is too long for its kind")
        checksum = _checksum(head, packet)
        end = begin + size + len(checksum)
        if not self._fill(end):
            raise _InvalidRecord("the checksum of a record is missing")
        if self._buffer[end - len(checksum) : end] != checksum:
            raise _InvalidRecord("the checksum of a record is wrong", end)
        return packet, end

    def _head(self, start: int) -> bytes:
        end = start
        while end == start or self._buffer[end - 1] >= 0x80:
            end += 1
            if end - start > MAX_HEAD_BYTES:
                raise _InvalidRecord("the length of a record is too large")
            if not self._fill(end):
                raise _InvalidRecord("in the length of a record")
        head = self._buffer[start:end]
        if len(head) > 1 and not head[-1]:
            raise _InvalidRecord("the length of a record has a byte too many")
        return head

    def _skip(self, damage: _InvalidRecord) -> ProtocolError:
        """Resynchronise after a damaged record; return the error to raise."""
        offset = self._offset
        self._fill(MAX_SEARCH_BYTES)
        for start in self._candidates(damage.end):
            for missing in range(MAX_MISSING + 1):
                sequence = (self._sequence + missing) % SEQUENCE_MODULUS
                if self._is_trusted(start, sequence):
                    self._sequence = sequence
                    self._drop(start)
                    return DamagedRecord(f"byte {offset}: {damage}")
        if damage.end is None:
            self._drop(len(self._buffer))
            return TruncatedCall(offset, str(damage))
        # The damaged record is the last one.
        self._drop(damage.end)
        return DamagedRecord(f"byte {offset}: {damage}")

    def _candidates(self, end: int | None) -> Iterator[int]:
        if end is not None:
            yield end
        yield from range(1, len(self._buffer))

    def _is_trusted(self, start: int, sequence: int) -> bool:
        """Whether `TRUSTED_RUN` valid records begin at `start`, or the last ones of the call."""
        for _ in range(TRUSTED_RUN):
            try:
                packet, start = self._parse(start, sequence)
            except _InvalidRecord:
                return False
            if is_end(packet):
                return True
            sequence = _sequence_after(packet, sequence)
        return True

    def _fill(self, count: int) -> bool:
        """Read ahead; whether `count` bytes are in the buffer."""
        while len(self._buffer) < count:
            more = self._file.read(count - len(self._buffer))
            if not more:
                return False
            self._buffer += more
        return True

    def _drop(self, count: int) -> None:
        self._buffer = self._buffer[count:]
        self._offset += count


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
