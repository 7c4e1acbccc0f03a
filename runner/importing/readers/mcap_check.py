"""Is an MCAP file whole, as far as it goes? Asked before rerun's reader sees it.

That reader takes every length for true, and goes on for ever where a compressed chunk is spoilt. So all records are
walked through first, and every chunk is unpacked and held against its checksum: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from runner.errors import RecordingError
from runner.storage.limits import check_bytes, check_size

MAGIC = b"\x89MCAP0\r\n"
CHUNK, MESSAGE, FOOTER, LAST, PRIVATE = 0x06, 0x05, 0x02, 0x0F, 0x80
CODECS = {"lz4": "lz4", "zstd": "zstd"}


def check_mcap(path: Path) -> None:
    """Refuse an MCAP file with a spoilt record; one that was cut off is whole as far as it goes.

    Raises:
        RecordingError: Naming the place.
        LimitError: If it holds too much once it is unpacked.
    """
    check_size(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RecordingError(f"{path}: can't be read: {error.strerror}.") from None
    if not data.startswith(MAGIC):
        raise RecordingError(f"{path}: can't be read as MCAP: it does not begin as such a file.")
    held = 0
    try:
        for opcode, begin, content in _records(memoryview(data)[len(MAGIC) :], len(MAGIC)):
            if opcode == CHUNK:
                held += _unpacked_size(content)
                check_bytes(path, held)
                _check_chunk(content, begin)
    except (ValueError, struct.error, pa.ArrowException, OSError) as error:
        raise RecordingError(f"{path}: can't be read as MCAP: {' '.join(str(error).split())}.") from None


def _records(data: memoryview, offset: int, *, cut_off: bool = True) -> Iterator[tuple[int, int, memoryview]]:
    """Yield kind, place and content of the records of a file or a chunk, up to its footer or to where it was cut off.

    Raises:
        ValueError: If there is a record of a kind that does not exist, or that is too long for a chunk.
    """
    at = 0
    while at + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, at)
        if opcode == 0 or LAST < opcode < PRIVATE:
            raise ValueError(f"there is no kind {opcode} of record, as at byte {offset + at}")
        if at + 9 + length > len(data):
            if cut_off and opcode != CHUNK:
                return
            if cut_off and _unpacked_size(data[at + 9 :]) < 2**40:
                return
            raise ValueError(f"the record at byte {offset + at} says that it has {length:,} bytes")
        yield opcode, offset + at, data[at + 9 : at + 9 + length]
        if opcode == FOOTER:
            return
        at += 9 + length
    if not cut_off and at != len(data):
        raise ValueError(f"{len(data) - at} bytes are left over at byte {offset + at}")


def _unpacked_size(content: memoryview) -> int:
    return struct.unpack_from("<Q", content, 16)[0] if len(content) >= 24 else 0


def _check_chunk(content: memoryview, begin: int) -> None:
    """Refuse a chunk that is not what its head and its checksum say.

    Raises:
        ValueError, struct.error, ArrowException, OSError: If it is not.
    """
    where = f"the chunk at byte {begin}"
    _, _, size, checksum, length = struct.unpack_from("<QQQII", content)
    name = bytes(content[32 : 32 + length]).decode()
    (packed,) = struct.unpack_from("<Q", content, 32 + length)
    records = content[40 + length :]
    if packed != len(records):
        raise ValueError(f"{where} has {len(records):,} bytes of records, not {packed:,}")
    if name in CODECS:
        records = memoryview(pa.Codec(CODECS[name]).decompress(pa.py_buffer(records), size))
    elif name:
        raise ValueError(f"{where} is packed by '{name[:20]}', which is not read")
    if len(records) != size or (checksum and zlib.crc32(records) != checksum):
        raise ValueError(f"{where} is not what its checksum says")
    for opcode, at, message in _records(records, 0, cut_off=False):
        if opcode == MESSAGE and len(message) < 22:
            raise ValueError(f"{where} has a message without a head at its byte {at}")
