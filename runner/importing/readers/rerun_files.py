"""MCAP and `.rrd`, by rerun's readers: ROS 2 messages and protobuf by their own schemas, JSON by Python's parser.

Those readers abort, or go on for ever, on some spoilt files, which nothing in Python can catch: a process of their own
reads for them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
from rerun.chunk import Chunk, McapReader, RrdReader

from runner.importing.readers.arrow import compute, signals_of
from runner.importing.readers.mcap_check import check_mcap
from runner.importing.signals import BULKY, Clock, Log, ReadOptions, Signal, bulky_notes, file_error, part_of
from runner.processes.apart import EndedError, apart

DECODERS = ("ros2_reflection", "protobuf", "raw")  # as the messages are, not as a viewer draws them
STAMPED = {"message_log_time": "log_time", "message_publish_time": "publish_time"}  # others are derived from messages
RAW = "McapMessage:data"
SCALARS = "Scalars:scalars"
LABELS = "SeriesLines:names"
PATIENCE_S, SLOWEST_BYTES_S = 30.0, 2e5  # a reader that takes longer than these has lost its way
OWN = ("/__properties", "/__mcap_properties", "/__hdf5_properties")


@dataclass(eq=False)
class _Component:
    """Rows of one component of one entity, gathered over chunks."""

    columns: list[pa.Array] = field(default_factory=list)
    stamps: list[dict[str, tuple[pa.Array, bool]]] = field(default_factory=list)

    def add(self, batch: pa.RecordBatch, name: str, clocks: dict[str, tuple[pa.Array, bool]]) -> None:
        column = batch.column(name)
        has = compute.greater(compute.fill_null(compute.list_value_length(column), 0), 0)
        if not compute.all(has).as_py():
            column = column.filter(has)
            clocks = {k: (stamps.filter(has), ns) for k, (stamps, ns) in clocks.items()}
        if len(column):
            self.columns.append(column)
            self.stamps.append(clocks)

    def whole(self) -> tuple[pa.Array, dict[str, Clock]]:
        """Return all rows, and the clocks that every chunk has."""
        shared = [k for k in self.stamps[0] if all(k in s for s in self.stamps)]
        clocks = {}
        for name in shared:
            stamps = pa.concat_arrays([s[name][0] for s in self.stamps])
            if not stamps.null_count:
                clocks[name] = Clock(stamps.to_numpy(zero_copy_only=False), in_ns=self.stamps[0][name][1])
        return pa.concat_arrays(self.columns), clocks


def read_mcap(path: Path, options: ReadOptions) -> Log:
    """Read an MCAP file; of one that was cut off, what is there.

    Raises:
        RecordingError: If it is none.
    """
    return _apart(_read_mcap, path, options, "MCAP")


def read_rrd(path: Path, options: ReadOptions) -> Log:
    """Read a rerun recording: every component that is numbers; each recording in the file is a part.

    Raises:
        RecordingError: If it is none.
    """
    return _apart(_read_rrd, path, options, "rerun recording")


def _apart(read: Callable[[Path, ReadOptions], Log], path: Path, options: ReadOptions, what: str) -> Log:
    try:
        return apart(read, path, options, patience_s=PATIENCE_S + path.stat().st_size / SLOWEST_BYTES_S)
    except (EndedError, OSError) as error:
        raise file_error(path, what, error) from None


def _read_mcap(path: Path, options: ReadOptions) -> Log:
    notes: list[str] = []
    check_mcap(path)
    try:
        chunks, json_topics, bulky = _mcap_chunks(path, recover=False)
    except (ValueError, RuntimeError) as error:
        if "recovery" not in str(error):
            raise file_error(path, "MCAP", error) from None
        try:
            chunks, json_topics, bulky = _mcap_chunks(path, recover=True)
        except (ValueError, RuntimeError) as again:
            raise file_error(path, "MCAP", again) from None
        notes.append(f"{path.name}: was cut off while it was written; read as far as it goes")
    notes += bulky_notes(path, bulky)
    signals: list[Signal] = []
    for (entity, name), component in _gathered(chunks).items():
        column, clocks = component.whole()
        clocks = {STAMPED[k]: c for k, c in clocks.items() if k in STAMPED}
        if name == RAW:
            if entity not in json_topics:
                notes.append(f"{path.name}: topic '{entity}' is in an encoding that is not read")
                continue
            column = _from_json(path, entity, column)
        else:
            column = compute.list_element(column, 0)
        signals += signals_of(entity, column, clocks)
    return Log("MCAP", [part_of(path.name, signals)], notes)


def _mcap_chunks(path: Path, *, recover: bool) -> tuple[list[Chunk], set[str], list[str]]:
    """Return what stands in a file, which topics are JSON, and which are left out for what they hold."""
    channels = McapReader(path, recover=recover).info().channels
    bulky = sorted({c.topic for c in channels if c.schema is not None and BULKY.search(c.schema.name)})
    without = [f"^{re.escape(topic)}$" for topic in bulky]
    reader = McapReader(path, decoders=DECODERS, recover=recover, exclude_topic_regex=without)
    return list(reader.stream()), {c.topic for c in channels if c.message_encoding == "json"}, bulky


def _from_json(path: Path, topic: str, column: pa.Array) -> pa.Array:
    messages = []
    for row in column:
        try:
            messages.append(json.loads(bytes(row.values[0].values.to_numpy(zero_copy_only=False))))
        except (ValueError, RecursionError) as error:
            raise file_error(path, f"JSON (message {len(messages) + 1} of topic '{topic}')", error) from None
    return nested(path, topic, messages)


def nested(path: Path, topic: str, messages: list) -> pa.Array:
    """Return messages of plain data as an Arrow array.

    Raises:
        RecordingError: If a field changes its type from message to message.
    """
    try:
        return pa.array(messages)
    except (pa.ArrowException, ValueError, OverflowError) as error:
        raise file_error(path, f"messages of topic '{topic}'", error) from None


def _read_rrd(path: Path, options: ReadOptions) -> Log:
    try:
        reader = RrdReader(path)
        recordings = reader.recordings()
        stores = [(entry.recording_id, list(reader.stream(store=entry))) for entry in recordings]
    except (ValueError, OSError, RuntimeError) as error:
        raise file_error(path, "rerun recording", error) from None
    several = len(stores) > 1
    parts = []
    for number, (_, chunks) in enumerate(stores):
        labels = _labels(chunks)
        signals: list[Signal] = []
        for (entity, name), component in _gathered(chunks).items():
            column, clocks = component.whole()
            root = entity if name == SCALARS else f"{entity}/{name.rpartition(':')[2]}"
            if (compute.max(compute.list_value_length(column)).as_py() or 0) <= 1:
                column = compute.list_element(column, 0)  # one instance: the number itself; empty rows are not kept
            signals += signals_of(entity, column, clocks, root=root, names=labels.get(entity))
        parts.append(part_of(f"{path.name}:{number}" if several else path.name, signals))
    return Log("rerun recording", parts)


def _labels(chunks: Iterable[Chunk]) -> dict[str, list[str]]:
    """Return the names of the series of an entity, which stand in a chunk without time."""
    found = {}
    for chunk in chunks:
        batch = chunk.to_record_batch()
        if chunk.is_static and LABELS in batch.schema.names:
            found[chunk.entity_path] = batch.column(LABELS)[-1].as_py()
    return found


def _gathered(chunks: Iterable[Chunk]) -> dict[tuple[str, str], _Component]:
    """Return what was logged over time, by entity and component."""
    found: dict[tuple[str, str], _Component] = {}
    for chunk in chunks:
        if chunk.is_static or chunk.entity_path.startswith(OWN):
            continue
        batch = pa.RecordBatch.from_arrays(chunk.to_record_batch().columns, schema=chunk.to_record_batch().schema)
        kinds = {f.name: (f.metadata or {}).get(b"rerun:kind", b"") for f in batch.schema}
        clocks = {n: _stamps(batch.column(n)) for n, kind in kinds.items() if kind == b"index"}
        for name, kind in kinds.items():
            if kind == b"data" and pa.types.is_list(batch.column(name).type) and not _is_blob(name, batch):
                found.setdefault((chunk.entity_path, name), _Component()).add(batch, name, clocks)
    return {key: component for key, component in found.items() if component.columns}


def _is_blob(name: str, batch: pa.RecordBatch) -> bool:
    """Whether a component holds bytes, as images do; those of raw messages are wanted."""
    inner = batch.column(name).type.value_type
    return name != RAW and pa.types.is_list(inner) and pa.types.is_uint8(inner.value_type)


def _stamps(column: pa.Array) -> tuple[pa.Array, bool]:
    """Return a timeline as whole numbers, and whether they are nanoseconds."""
    in_ns = pa.types.is_timestamp(column.type) or pa.types.is_duration(column.type)
    return column.cast(pa.int64()), in_ns
