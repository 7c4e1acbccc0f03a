"""Is an MCAP file whole, as far as it goes? Asked before rerun's reader sees it.

That reader takes every length for true, and goes on for ever where a compressed chunk is spoilt. So all records are
walked through first, and every chunk is unpacked and held against its checksum: https://mcap.dev/spec.
"""

from __future__ import annotations

import mmap
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa

from runner.errors import RecordingError
from runner.storage.limits import check_bytes

MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX = 0x03, 0x04, 0x05, 0x06, 0x08
FOOTER, LAST, PRIVATE = 0x02, 0x0F, 0x80
CODECS = {"lz4": "lz4", "zstd": "zstd"}


def check_mcap(path: Path) -> None:
    """Refuse an MCAP file with a spoilt record; one that was cut off is whole as far as it goes.

    Raises:
        RecordingError: Naming the place.
        LimitError: If a chunk holds too much once it is unpacked.
    """
    try:
        with path.open("rb") as file:
            data = memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))  # closed with the last view of it
        if data[: len(MAGIC)] != MAGIC:
            raise ValueError("it does not begin as such a file")
        chunks: dict[int, int] = {}
        for opcode, begin, content in _records(data[len(MAGIC) :], len(MAGIC)):
            if opcode == CHUNK_INDEX:
                start, length = struct.unpack_from("<QQ", content, 16)
                if chunks.get(start) != length:
                    raise ValueError(
                        f"the record at byte {begin} speaks of a chunk at byte {start}, where there is none"
                    )
            if opcode == CHUNK:
                chunks[begin] = 9 + len(content)
                check_bytes(path, _unpacked_size(content))
                _check_chunk(content, begin)
            _check_names(opcode, content, f"the record at byte {begin}")
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
        _check_names(opcode, message, where)


def _check_names(opcode: int, content: memoryview, where: str) -> None:
    """Refuse names of topics and of fields with a zero in them, which end the process that makes tables of them."""
    if opcode not in (SCHEMA, CHANNEL):
        return
    at, texts = (2 if opcode == SCHEMA else 4), []
    for _ in range(3 if opcode == SCHEMA else 2):  # name, encoding, definition; topic, encoding
        (length,) = struct.unpack_from("<I", content, at)
        texts.append(bytes(content[at + 4 : at + 4 + length]))
        at += 4 + length
    if texts[1] == b"protobuf":
        texts = texts[:2]
    if any(b"\0" in text for text in texts):
        raise ValueError(f"{where} has a name or a definition with a zero in it")
