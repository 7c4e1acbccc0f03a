"""A fast slice of the fuzzing, and what it found: every input is read or refused in a line."""

from __future__ import annotations

import struct
from pathlib import Path

import pyarrow as pa
import pytest

from runner.__main__ import main
from runner.errors import RecordingError, RunnerError
from runner.importing.readers import read_log
from runner.importing.readers.mcap_check import MAGIC
from runner.importing.signals import ReadOptions
from runner.teleop import tables
from tests.fuzzing.readers import Reader, readers
from tests.fuzzing.trial import kind_of, trial

SLOW = ("config",)  # half a second each
TRIALS = 130  # of all kinds together
# numbers of the 100,000 with seed 0, and of as many with seed 1, that were neither read nor refused when they were
# first tried: a reader that aborts or does not end, errors that were called a bug
FOUND = {
    0: (11, 77, 219, 298, 335, 569, 637, 1192, 1894, 39906, 41289, 46050, 48850, 52282, 69731, 81091, 200678, 201171),
    1: (136, 7070, 11384, 14023, 21177, 26169, 42716),
}


@pytest.fixture(scope="module")
def kinds() -> dict[str, Reader]:
    """All kinds of inputs."""
    return readers()


def test_good_inputs_are_read(kinds: dict[str, Reader], tmp_path: Path) -> None:
    """What is spoilt is good before: else everything would be refused, and nothing tried."""
    for name, reader in kinds.items():
        for file, content in reader.good.items():
            (tmp_path / name / file).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name / file).write_bytes(content)
        reader.read(tmp_path / name)


def test_spoilt_inputs_are_read_or_refused(kinds: dict[str, Reader], tmp_path: Path) -> None:
    """A few of each kind; `make fuzz` tries 100,000."""
    numbers = [n for n in range(10**6, 10**6 + TRIALS) if kind_of(n, kinds) not in SLOW]
    outcomes = [trial(kinds, 3, number, tmp_path / "t") for number in numbers]
    assert [problem for _, problem in outcomes if problem] == []
    assert {outcome for outcome, _ in outcomes} == {"read", "refused"}


@pytest.mark.parametrize(("seed", "number"), [(seed, n) for seed, numbers in FOUND.items() for n in numbers])
def test_what_was_found(kinds: dict[str, Reader], tmp_path: Path, seed: int, number: int) -> None:
    """Inputs that were neither read nor refused once."""
    outcome, problem = trial(kinds, seed, number, tmp_path / "t")
    assert (outcome, problem) in (("read", ""), ("refused", ""))


def _record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def _chunk(records: bytes, *, size: int | None = None, checksum: int = 0, packed: str = "") -> bytes:
    head = struct.pack("<QQQII", 0, 1, len(records) if size is None else size, checksum, len(packed))
    return _record(6, head + packed.encode() + struct.pack("<Q", len(records)) + records)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "can't be read as MCAP"),
        (b"PK\x03\x04" * 9, "does not begin as such a file"),
        (MAGIC + _record(0x16, b"x"), "there is no kind 22 of record, as at byte 8"),
        (MAGIC + _chunk(b"", size=2**62, packed="zstd"), "at most 1,000 MB"),
        (MAGIC + _chunk(_record(5, b"x" * 30), checksum=7), "is not what its checksum says"),
        (MAGIC + _chunk(b"spoilt", size=40, packed="zstd"), "can't be read as MCAP"),
        (MAGIC + _chunk(_record(5, b"x" * 9)), "has a message without a head"),
        (MAGIC + _chunk(b"x", packed="bz2"), "is packed by 'bz2', which is not read"),
        (MAGIC + _record(4, struct.pack("<HHI", 1, 1, 2) + b"/\0" + struct.pack("<I", 0)), "with a zero in it"),
        (MAGIC + _record(8, struct.pack("<QQQQ", 0, 1, 99, 9)), "speaks of a chunk at byte 99, where there is none"),
        (MAGIC + struct.pack("<BQ", 6, 2**50) + struct.pack("<QQQ", 0, 1, 2**50), "says that it has"),
    ],
)
def test_spoilt_mcap(tmp_path: Path, content: bytes, words: str) -> None:
    """Said before rerun sees it, which would ask for exabytes or go on for ever."""
    (tmp_path / "log.mcap").write_bytes(content)
    with pytest.raises(RunnerError, match=words):
        read_log([tmp_path / "log.mcap"], ReadOptions())


def test_a_bomb_in_a_summary_or_a_log(tmp_path: Path) -> None:
    """The limits of recordings hold for logs that are imported, and for tables of results, too."""
    import pyarrow.parquet as pq

    rows = pa.table({"job": pa.DictionaryArray.from_arrays(pa.array([0] * 6_000_000, pa.int8()), pa.array([1.0]))})
    pq.write_table(rows, tmp_path / "summary.parquet")
    with pytest.raises(RunnerError, match="has 6,000,000 rows, at most 5,000,000 are read"):
        read_log([tmp_path / "summary.parquet"], ReadOptions())
    with pytest.raises(RunnerError, match="has 6,000,000 rows"):
        tables.collect([tmp_path])


def test_a_lerobot_set_without_rows(tmp_path: Path, kinds: dict[str, Reader]) -> None:
    """It has no episodes: said, where the split into them failed."""
    import pandas as pd

    for file, content in kinds["log_lerobot_v3"].good.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(content)
    (data,) = tmp_path.rglob("file-*.parquet")
    pd.read_parquet(data).iloc[:0].to_parquet(data)
    with pytest.raises(RecordingError, match="'episode_index' of its data must be a number in every row"):
        kinds["log_lerobot_v3"].read(tmp_path)


def test_notes_of_a_sweep_that_are_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Lines of something else are passed over, a summary of something else is refused."""
    (tmp_path / "sweep.txt").write_text("run seed=1,2\n")
    (tmp_path / "rows").mkdir()
    lines = [b'{"job": 1, "rows": [{"job": 1, "status": "done"}]}', b"[1]", b'{"job": "x", "rows": 3}', b"\xff\xfe"]
    (tmp_path / "rows" / "0.jsonl").write_bytes(b"\n".join(lines))
    assert tables.sweep_rows(tmp_path) == [{"job": 1, "status": "done"}]
    tables.write_summary([{"status": "done"}], tmp_path)
    assert main(["table", str(tmp_path)]) == 2
    assert "is not of a sweep: a row has no number in 'job'" in capsys.readouterr().err


def test_a_library_that_aborts_ends_a_process_of_its_own(tmp_path: Path) -> None:
    """A protobuf schema with a zero in a field's name aborts the reader."""
    from google.protobuf import descriptor_pb2
    from mcap.writer import Writer

    kind = descriptor_pb2.FieldDescriptorProto
    field = kind(name="a\0b", number=1, type=kind.TYPE_DOUBLE, label=kind.LABEL_OPTIONAL)
    message = descriptor_pb2.DescriptorProto(name="Sample", field=[field])
    file = descriptor_pb2.FileDescriptorProto(name="arm.proto", package="arm", syntax="proto3", message_type=[message])
    with (tmp_path / "log.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schemas = descriptor_pb2.FileDescriptorSet(file=[file]).SerializeToString()
        schema = writer.register_schema("arm.Sample", "protobuf", schemas)
        channel = writer.register_channel("/arm", "protobuf", schema)
        content = b"\x09" + struct.pack("<d", 1.0)
        writer.add_message(channel, log_time=1, publish_time=1, data=content)
        writer.finish()
    with pytest.raises(RunnerError, match=r"can't be read as MCAP: ended the process that read it \("):
        read_log([tmp_path / "log.mcap"], ReadOptions())
