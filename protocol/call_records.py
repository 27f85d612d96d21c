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
from dataclasses import dataclass
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
# Bytes that searches may look at, at first and for each byte of the file that has been read; a
# look at an offset counts as some.
SEARCH_WORK, WORK_PER_BYTE, WORK_PER_LOOK = 4 * 1024 * 1024, 16, 16


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


@dataclass(frozen=True, slots=True)
class _Record:
    """Where a record lies, by its length.  body: first byte after the head; end: of the body."""

    start: int
    body: int
    end: int
    is_whole: bool


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
        self._buffer = bytearray()
        self._sequence = 0
        self._work = SEARCH_WORK

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
        record = self._locate(start)
        return self._checked(record, sequence), self._end(record)

    def _locate(self, start: int) -> _Record:
        """The record at `start` by its lengths, which are possible and within the file."""
        head = self._head(start)
        value, _ = decode_varint(head)
        size, whole = value // 2, value % 2
        if not 1 <= size + (not whole) <= MAX_MODEL_PACKET_BYTES:
            raise _InvalidRecord(f"record of {size} bytes")
        record = _Record(start, start + len(head), start + len(head) + size, bool(whole))
        if not whole and 1 + size > max_packet_bytes(PacketKind.FRAME):
            raise _InvalidRecord(f"frame packet of {size} bytes")
        if not self._fill(record.end):
            raise _InvalidRecord(f"record has {len(self._buffer) - record.body} bytes of {size}")
        if size + (not whole) > max_packet_bytes(self._kind(record)):
            raise _InvalidRecord(f"packet of {size} bytes is too long for its kind")
        if not self._fill(self._end(record)):
            raise _InvalidRecord("the checksum of a record is missing")
        return record

    def _checked(self, record: _Record, sequence: int) -> bytes:
        """The packet of a record; with byte 0, which may be omitted."""
        head = bytes(self._buffer[record.start : record.body])
        packet = bytes(self._buffer[record.body : record.end])
        if not record.is_whole:
            packet = bytes([sequence]) + packet
        end = self._end(record)
        if self._buffer[record.end : end] != _checksum(head, packet):
            raise _InvalidRecord("the checksum of a record is wrong", end)
        return packet

    def _kind(self, record: _Record) -> PacketKind:
        return (
            packet_kind(bytes(self._buffer[record.body : record.body + 1]))
            if record.is_whole
            else PacketKind.FRAME
        )

    def _end(self, record: _Record) -> int:
        """The end of a record with its checksum."""
        return record.end + _checksum_bytes(self._kind(record))

    def _head(self, start: int) -> bytes:
        end = start
        while end == start or self._buffer[end - 1] >= 0x80:
            end += 1
            if end - start > MAX_HEAD_BYTES:
                raise _InvalidRecord("the length of a record is too large")
            if not self._fill(end):
                raise _InvalidRecord("in the length of a record")
        head = bytes(self._buffer[start:end])
        if len(head) > 1 and not head[-1]:
            raise _InvalidRecord("the length of a record has a byte too many")
        return head

    def _skip(self, damage: _InvalidRecord) -> ProtocolError:
        """Resynchronise after a damaged record; return the error to raise."""
        offset = self._offset
        self._fill(MAX_SEARCH_BYTES)
        for start in self._candidates(damage.end):
            records = self._run(start)
            for missing in range(MAX_MISSING + 1) if records else ():
                sequence = (self._sequence + missing) % SEQUENCE_MODULUS
                if self._is_trusted(records, sequence):
                    self._sequence = sequence
                    self._drop(start)
                    return DamagedRecord(f"byte {offset}: {damage}")
            if self._work <= 0:
                break
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

    def _run(self, start: int) -> list[_Record]:
        """`TRUSTED_RUN` records from `start` on, or the last ones of the call; none by lengths."""
        records = list[_Record]()
        while len(records) < TRUSTED_RUN:
            self._work -= WORK_PER_LOOK
            try:
                records.append(self._locate(start))
            except _InvalidRecord:
                return []
            record = records[-1]
            if record.is_whole and is_end(bytes(self._buffer[record.body : record.end])):
                break
            start = self._end(record)
        return records

    def _is_trusted(self, records: list[_Record], sequence: int) -> bool:
        """Whether the checksums of records that follow one another are right."""
        for record in records:
            self._work -= record.end - record.start + WORK_PER_LOOK
            try:
                packet = self._checked(record, sequence)
            except _InvalidRecord:
                return False
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
        del self._buffer[:count]
        self._offset += count
        self._work = min(self._work + WORK_PER_BYTE * count, SEARCH_WORK)


def _sequence_after(packet: bytes, before: int) -> int:
    is_frame = packet_kind(packet) is PacketKind.FRAME
    return (packet[0] + 1) % SEQUENCE_MODULUS if is_frame else before


def _checksum(head: bytes, packet: bytes) -> bytes:
    if _checksum_bytes(packet_kind(packet)) > 1:
        return crc32(packet, crc32(head)).to_bytes(4, "big")
    return bytes([_crc8(head + packet)])


def _checksum_bytes(kind: PacketKind) -> int:
    return 4 if kind in (PacketKind.MODEL, PacketKind.LAYER) else 1


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
