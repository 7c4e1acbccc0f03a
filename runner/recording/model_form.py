"""Recordings in the model form: anybody's MuJoCo model, and a log of a mechanism that it should describe.

A case is a folder with `recording.parquet` (or `.csv`), the MJCF that its owner believes in, and `nominal.yaml`, whose
key `model` names the MJCF and whose other keys say how columns and model belong together; a folder without `model` is
in the box form. See `runner.recording.model_form_mapping` for the keys, `runner.recording.model_form_mjcf` for what an
MJCF may refer to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from runner.errors import RecordingError, nearest
from runner.numerics.arrays import FloatArray
from runner.recording.case import table_file
from runner.recording.checks import episode_spans, lacking_notes, rising_steps
from runner.recording.data import frozen_array
from runner.recording.model_form_commands import note_commands
from runner.recording.model_form_limits import note_limits
from runner.recording.model_form_mapping import ChannelSource, ModelMapping, read_mapping
from runner.recording.model_form_mjcf import read_mjcf
from runner.recording.model_form_plausible import note_channels
from runner.recording.nominal import FILE, load_mapping
from runner.recording.raw_table import RawTable, numbers, read_raw
from runner.recording.table import Table
from runner.storage.limits import check_shape

FASTEST_S, SLOWEST_S = 2e-5, 1.0  # sampled more often, or less: the times are in another unit
TURNS = 5  # a joint that goes round more often without a range: worth a note
ROUND = 12  # rows that hold whole rounds of two, three, four or six streams
NORM = (0.9, 1.1)  # a quaternion of a length within is a rounded one


@dataclass(frozen=True, eq=False)
class MechanismEpisode:
    """One run of a mechanism.

    Args:
        index: Its number in the recording.
        t_s: Time of each sample, (T,), rising, not necessarily even.
        values: Measured channels, (T, C), NaN where not measured; orientations 0 (see `orientations`).
        commands: Held from each sample to the next, (T, K).
        forces_n: Recorded forces on bodies, world axes, (T, F, 3).
        points_m: Where they act, axes of the body, from its origin, (T, F, 3).
        orientations: Measured orientation by channel without its axis, (T, 4) w, x, y, z, body to world.
        after: The part of the same run that this one goes on from, if any: commands of then may still be to come.
    """

    index: int
    t_s: FloatArray
    values: FloatArray
    commands: FloatArray
    forces_n: FloatArray
    points_m: FloatArray
    orientations: Mapping[str, FloatArray]
    after: MechanismEpisode | None = None

    def __post_init__(self) -> None:
        for name in ("t_s", "values", "commands", "forces_n", "points_m"):
            object.__setattr__(self, name, frozen_array(getattr(self, name)))
        object.__setattr__(self, "orientations", {k: frozen_array(v) for k, v in self.orientations.items()})

    def __len__(self) -> int:
        return len(self.t_s)

    @cached_property
    def step_s(self) -> float:
        """Usual time from one sample to the next."""
        return _usual_step_s([self])


def _usual_step_s(episodes: Sequence[MechanismEpisode]) -> float:
    """Return the median time from one sample to the next.

    Where streams have rows of their own, short steps and long ones alternate (1 ms to the next topic, 9 ms to the next
    round), and their median is either: there the time that several rows take is shared out among them.
    """
    apart = any(np.isnan(e.values).any(axis=0).all() for e in episodes)
    rows = max(1, min(ROUND, *(len(e) - 1 for e in episodes))) if apart else 1
    return float(np.median(np.concatenate([(e.t_s[rows:] - e.t_s[:-rows]) / rows for e in episodes])))


@dataclass(frozen=True, eq=False)
class MechanismRecording:
    """A case: runs of one mechanism, and the model that its owner believes in.

    Args:
        path: Where it was read from.
        model_path: The MJCF.
        mapping: How columns and model belong together, what noise is stated, how episodes start.
        episodes: At least one, in the order of the file.
        notes: What was odd about the files, yet no error: one sentence each.
    """

    path: Path
    model_path: Path
    mapping: ModelMapping
    episodes: tuple[MechanismEpisode, ...]
    notes: tuple[str, ...] = ()

    @property
    def nominal(self) -> ModelMapping:
        """What the owner states beside the MJCF."""
        return self.mapping

    @cached_property
    def step_s(self) -> float:
        """Usual time from one sample to the next."""
        return _usual_step_s(self.episodes)

    def spec(self) -> mujoco.MjSpec:
        """Return the MJCF, read anew: it may be edited."""
        return read_mjcf(self.model_path)


def with_episode_to_check(recording: MechanismRecording) -> MechanismRecording:
    """Return a recording of one episode as two, of which the second, its last third, can be kept from every fit.

    That is the convention of the format. The second begins wherever the first has got to. Other recordings are
    returned as they are.
    """
    if len(recording.episodes) != 1:
        return recording
    (whole,) = recording.episodes
    cut = len(whole) - len(whole) // 3
    first, second = (_part(whole, number, s) for number, s in ((0, slice(0, cut)), (1, slice(cut, None))))
    second = replace(second, after=first)
    note = f"one episode: its last third, from {whole.t_s[cut]:.6g} s on, is kept from the fit as episode 1"
    return replace(
        recording,
        mapping=replace(recording.mapping, rests=False),
        episodes=(first, second),
        notes=(*recording.notes, note),
    )


def _part(episode: MechanismEpisode, index: int, samples: slice) -> MechanismEpisode:
    return MechanismEpisode(
        index=index,
        t_s=episode.t_s[samples],
        values=episode.values[samples],
        commands=episode.commands[samples],
        forces_n=episode.forces_n[samples],
        points_m=episode.points_m[samples],
        orientations={name: q[samples] for name, q in episode.orientations.items()},
    )


def nominal_file(path: str | Path) -> Path:
    """Return where the beliefs of a case stand: beside its table, or in its folder."""
    path = Path(path)
    return (path if path.is_dir() else path.parent) / FILE


def is_model_form(path: str | Path) -> bool:
    """Whether a folder's `nominal.yaml` names a model; a folder without the file, or with a broken one, does not."""
    file = nominal_file(path)
    try:
        return file.is_file() and "model" in load_mapping(file, ("model",))
    except RecordingError:
        return False


def read_model_case(path: str | Path) -> MechanismRecording:
    """Return a case in model form, checked: keys, names in the model, columns, numbers, order, times, units.

    Args:
        path: The folder, or a table in it (`.parquet` or `.csv`).

    Raises:
        RecordingError: With the file, the key or the data row, the value and what is allowed.
    """
    path = Path(path)
    file, notes = table_file(path)
    nominal = file.parent / FILE
    content = load_mapping(nominal, ("model", "commands", "channels"))
    model_path = _model_path(nominal, content.get("model"))
    model = read_mjcf(model_path).compile()
    mapping = read_mapping(nominal, content, model)
    raw = read_raw(file)
    table = _table(file, raw, mapping, notes)
    spans = episode_spans(table)
    for span in spans:
        steps = rising_steps(table, span)
        if not FASTEST_S < np.median(steps) <= SLOWEST_S:
            raise table.error(
                f"column 't' rises by {np.median(steps):.4g} s per sample, allowed: {FASTEST_S:g} to {SLOWEST_S:g} s; "
                "probably not in s.",
                int(span.start),
            )
    _check_commands(table, mapping)
    notes += [*_undriven(mapping, model), *_check_angles(table, mapping, model)]
    orientations = {o.name: _orientation(table, o.columns) for o in mapping.orientations}
    values = _values(table, mapping, orientations)
    kept = [c for c, source in enumerate(mapping.sources) if np.isfinite(values[:, c]).any()]
    lacking = [s.name for c, s in enumerate(mapping.sources) if c not in kept]
    if lacking:
        raise table.error(f"channel '{lacking[0]}' is NaN in all {len(table)} rows; take it out of {FILE}.")
    notes += lacking_notes([s.name for s in mapping.sources], values)
    notes += note_channels(table, spans, mapping) or note_commands(table, spans, mapping, model)
    notes += note_limits(table, spans, mapping, model)
    commands = table.stack(mapping.commands) if mapping.commands else np.zeros((len(table), 0))
    forces = _triples(table, [f.force for f in mapping.forces])
    points = _triples(table, [f.point for f in mapping.forces])
    episodes = tuple(
        MechanismEpisode(
            int(table["episode"][s.start]),
            table["t"][s],
            values[s],
            commands[s],
            forces[s],
            points[s],
            {name: q[s] for name, q in orientations.items()},
        )
        for s in spans
    )
    return MechanismRecording(path, model_path, mapping, episodes, tuple(notes))


def _model_path(nominal: Path, name: object) -> Path:
    """Return the MJCF, which must lie in the case's folder."""
    if not isinstance(name, str) or not name:
        raise RecordingError(f"{nominal}: model: must be the name of an MJCF file in the same folder, got {name!r}.")
    path = nominal.parent / name
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise RecordingError(f"{nominal}: model: must lie in the folder of the case, got {name!r}.")
    if not path.is_file():
        files = [p.name for p in nominal.parent.iterdir() if p.suffix in (".xml", ".mjcf")]
        hint = f" {nearest(name, files)}" if files else " There is no .xml file in the folder."
        raise RecordingError(f"{nominal}: model: no file '{name}' in the folder.{hint}")
    return path


def _table(file: Path, raw: RawTable, mapping: ModelMapping, notes: list[str]) -> Table:
    """Return the columns that the mapping names; others are left unread, with a note."""
    header = raw.header
    wanted = dict.fromkeys(["episode", "t", *mapping.columns])
    for name in wanted:
        if header.count(name) > 1:
            raise RecordingError(f"{file}: column '{name}' is there {header.count(name)} times, allowed: once.")
    missing = [name for name in wanted if name not in header]
    if missing:
        by = "every recording needs it" if missing[0] in ("episode", "t") else f"{FILE} names it"
        raise RecordingError(f"{file}: missing column '{missing[0]}'; {by}. {nearest(missing[0], header)}")
    if not raw.count:
        raise RecordingError(f"{file}: has no rows; at least three samples of one episode are needed.")
    check_shape(file, raw.count, len(wanted))
    columns = {name: numbers(file, name, raw, mapping.units.get(name, "")) for name in wanted}
    extra = tuple(name for name in header if name not in wanted and not name.startswith("__index_level_"))
    if extra:
        notes.append(f"not named in {FILE} and not read: {', '.join(map(repr, extra))}")
    table = Table(file, columns, raw.lines, extra)
    for name, column in columns.items():
        may_lack = name not in ("episode", "t", *mapping.driving)
        bad = np.isinf(column) if may_lack else ~np.isfinite(column)
        if bad.any():
            row = int(np.argmax(bad))
            more = f" ({bad.sum()} such rows)" if bad.sum() > 1 else ""
            what = "a command must be a finite number" if name in mapping.driving else "must be a finite number"
            raise table.error(f"column '{name}': {what}, got {column[row]}{more}.", row)
    return table


def _check_commands(table: Table, mapping: ModelMapping) -> None:
    """Refuse a servo's target that is far outside of the range of its command, but inside as degrees."""
    for name, command in mapping.commands.items():
        if command.unit == "rad" and command.limits is not None and _degrees(table[name], command.limits):
            raise table.error(
                f"command '{name}' goes up to {np.abs(table[name]).max():.4g}, the range of actuator "
                f"'{command.actuator}' is {command.limits[0]:.4g} to {command.limits[1]:.4g} rad: "
                "probably in degrees, allowed: rad."
            )


def _check_angles(table: Table, mapping: ModelMapping, model: mujoco.MjModel) -> list[str]:
    """Refuse an angle far outside of its joint's range that is inside as degrees; note one of many turns."""
    notes = [
        _many_turns(name, turns)
        for name, command in mapping.commands.items()
        if command.unit == "rad"
        and command.limits is None
        and (turns := float(np.ptp(table[name])) / (2 * np.pi)) > TURNS
    ]
    for source in mapping.sources:
        if source.kind != "joint" or source.quantity != "position" or source.unit != "rad":
            continue
        values, joint = table[source.name], model.joint(source.target)
        if joint.limited[0] and _degrees(values, (float(joint.range[0]), float(joint.range[1]))):
            raise table.error(
                f"channel '{source.name}' goes up to {np.nanmax(np.abs(values)):.4g}, the range of joint "
                f"'{source.target}' is {joint.range[0]:.4g} to {joint.range[1]:.4g} rad: probably in degrees, "
                "allowed: rad."
            )
        turns = float(np.nanmax(values) - np.nanmin(values)) / (2 * np.pi) if np.isfinite(values).any() else 0.0
        if not joint.limited[0] and turns > TURNS:
            notes.append(_many_turns(source.name, turns))
    return notes


def _many_turns(column: str, turns: float) -> str:
    return f"'{column}' spans {turns:.0f} turns; if it is in degrees, turn it into rad (`unit: deg` in a map)"


def _undriven(mapping: ModelMapping, model: mujoco.MjModel) -> list[str]:
    """Return a note on actuators that nothing drives."""
    driven = {c.actuator for c in mapping.commands.values()}
    names = [model.actuator(a).name for a in range(model.nu)]
    idle = [repr(name) if name else f"number {a}" for a, name in enumerate(names) if name not in driven]
    if not idle:
        return []
    return [f"no command drives {'actuator' if len(idle) == 1 else 'actuators'} {', '.join(idle)}: 0 is sent there"]


def _degrees(values: FloatArray, limits: tuple[float, float]) -> bool:
    """Whether values lie far outside of limits, and as degrees within."""
    low, high = limits
    width = high - low
    extremes = np.array([np.nanmin(values, initial=0.0), np.nanmax(values, initial=0.0)])
    outside = max(low - extremes[0], extremes[1] - high)
    inside = np.radians(extremes[0]) > low - 0.1 * width and np.radians(extremes[1]) < high + 0.1 * width
    return bool(outside > 2 * width and inside)


def _orientation(table: Table, columns: Sequence[str]) -> FloatArray:
    """Return unit quaternions, (N, 4), NaN where one of the numbers is."""
    q = table.stack(columns)
    q = np.where(np.asarray(np.isnan(q).any(axis=1))[:, None], np.nan, q)
    length = np.linalg.norm(q, axis=1)
    bad = (length < NORM[0]) | (length > NORM[1])
    if bad.any():
        row = int(np.argmax(bad))
        raise table.error(
            f"columns {', '.join(map(repr, columns))} must be a quaternion of unit length, got length "
            f"{length[row]:.4g}.",
            row,
        )
    return q / length[:, None]


def _values(table: Table, mapping: ModelMapping, orientations: Mapping[str, FloatArray]) -> FloatArray:
    """Return all channels, (N, C); of an orientation 0, as its residual is a turn away from what was measured."""
    columns = []
    for source in mapping.sources:
        if source.quantity == "orientation":
            columns.append(orientations[source.column][:, 0] * 0.0)
        else:
            columns.append(table[source.name])
    return np.stack(columns, axis=1)


def _triples(table: Table, columns: Sequence[Sequence[str]]) -> FloatArray:
    """Return triples of columns, (N, F, 3); where none are named, zeros."""
    stacked = [table.stack(names) if names else np.zeros((len(table), 3)) for names in columns]
    return np.stack(stacked, axis=1) if stacked else np.zeros((len(table), 0, 3))


__all__ = ["ChannelSource", "MechanismEpisode", "MechanismRecording", "is_model_form", "read_model_case"]
