"""Propose a map: which signals look like which commands and channels of a model, in which unit, by which clock.

Everything is said: what was recognised and by what, what was only assumed, and what somebody has to fill in. Nothing
that a proposal gets wrong passes unseen: a map is read by its owner, and checked against ranges when it is used.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np
import yaml

from runner.importing.box import COMMANDED, NOISE
from runner.importing.clocks import rate_of
from runner.importing.guess.box import box_elements, match_box
from runner.importing.guess.clock import ClockGuess, clock_times, guess_clock
from runner.importing.guess.counter import guess_episodes
from runner.importing.guess.elements import Element, elements_of, match, match_followers
from runner.importing.guess.names import words_of
from runner.importing.guess.poses import Pose, guess_frame, guess_poses
from runner.importing.guess.rest import begins_at_rest
from runner.importing.guess.unit import (
    MUCH_M,
    UnitGuess,
    guess_unit,
    of_counts,
    unit_by_name,
    unit_by_slope,
    units_of_vectors,
    vector_of,
    with_unit,
)
from runner.importing.lost import moves_on
from runner.importing.map_file import ALL, COLUMN, NEAREST, TAKEN, TO_FILL, Between
from runner.importing.plausible import coarse_step
from runner.importing.signals import Log, Part, Signal
from runner.importing.units import UNITS, allowed
from runner.numerics.arrays import FloatArray
from runner.recording import Form, Nominal
from runner.recording.force_noise import force_noise
from runner.recording.table import FORCE, POINT, REQUIRED

SENT = frozenset(["cmd", "command", "commanded", "set", "setpoint", "desired", "des", "target", "goal", "ref"])
MEANING = {
    "px": "where the force acts, from the box's middle along its own x axis",
    "py": "where the force acts, from the box's middle along its own y axis",
    "fx": "the force along the world's x axis",
    "fy": "the force along the world's y axis",
}
SHOWN = 8  # names that are listed of what is not used


@dataclass(frozen=True, eq=False)
class Proposal:
    """A map to be edited.

    Args:
        text: Of `map.yaml`.
        table: What each signal that is used was taken for: signal, element, unit, why.
        missing: What has to be filled in, one sentence each.
        notes: What was assumed, one sentence each.
    """

    text: str
    table: list[tuple[str, str, str, str]]
    missing: list[str]
    notes: list[str]


@dataclass(eq=False)
class _Draft:
    commands: dict[str, dict] = field(default_factory=dict)
    channels: dict[str, dict] = field(default_factory=dict)
    why: dict[str, str] = field(default_factory=dict)
    noise: dict[str, float] = field(default_factory=dict)
    table: list[tuple[str, str, str, str]] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    unitless: dict[str, str] = field(default_factory=dict)
    used: list[Signal] = field(default_factory=list)
    rate_hz: float | None = None
    box: bool = False
    undriven: bool = False
    blank: dict[str, list[str]] = field(default_factory=dict)  # lines to be filled in, by what they belong to
    rests: bool = False


def propose(log: Log, model: mujoco.MjModel, *, rate_hz: float | None = None) -> Proposal:
    """Return a map for a log and a model.

    Args:
        log: What was read; its first part is looked at for names, all of them for sizes.
        model: The compiled MJCF.
        rate_hz: Of samples without a time, where it was given.
    """
    part = log.parts[0]
    draft = _Draft(rate_hz=rate_hz)
    elements = elements_of(model)
    clock = guess_clock(part)
    found = match(list(part.signals.values()), elements, besides=clock.names)
    match_followers(found, list(part.signals.values()), elements, model, clock.names)
    times = clock_times(part, clock)
    told = units_of_vectors([(element, signal) for element, signal, _ in found.pairs], log)
    for element, signal, why in found.pairs:
        by_others = told.get((vector_of(signal), element.si_unit)) if element.limits is None else None
        _add(draft, element, signal, why, log, _by_slope(draft, part, element, signal, times) or by_others)
    draft.notes += found.notes
    known = {*clock.names, *(s.name for s in draft.used)}
    poses, up = guess_frame(part, guess_poses(part, model, besides=known, times_s=times), model, times)
    for pose in poses:
        _add_pose(draft, pose, part, up.axis)
    _only_one_left(draft, elements, log, {*known, *(s.name for s in draft.used)})
    _lacking(draft, elements)
    if up.note:
        draft.notes.append(up.note)
    return _finished(draft, log, clock, {"rows": {"at": ALL}, "up": up.axis})


def propose_box(log: Log, nominal: Nominal, *, rate_hz: float | None = None) -> Proposal:
    """Return a map for a log of a box that is pushed over a floor.

    Args:
        log: What was read.
        nominal: What is believed of the box.
        rate_hz: Of samples without a time, where it was given.
    """
    part = log.parts[0]
    draft = _Draft(rate_hz=rate_hz, box=True)
    clock = guess_clock(part, empty_is_lost=True)
    elements = box_elements(nominal)
    found = match_box(list(part.signals.values()), elements, besides=clock.names)
    for element, signal, why in found.pairs:
        _add(draft, element, signal, why, log, _as_the_point(draft, part, element, signal))
    draft.notes += found.notes
    times = clock_times(part, clock)
    _lines(draft, part, times)
    named = {*draft.commands, *draft.channels}
    for column in REQUIRED[Form.PLANAR]:
        if column in elements and column not in named and not (nominal.pin is not None and column in COMMANDED):
            group = draft.commands if column in COMMANDED else draft.channels
            group[column] = {"signal": TO_FILL, "unit": TO_FILL}
            draft.why[column] = "nothing was recognised"
            draft.missing.append(_lacking_of_box(column, elements[column], part, {s.name for s in draft.used}))
    rate = nominal.rate_hz if times is None else rate_of(np.diff(times[np.isfinite(times)]))
    return _finished(draft, log, clock, {"rows": {"at": NEAREST, "rate_hz": float(f"{rate:.6g}")}})


def _lacking_of_box(column: str, element: Element, part: Part, used: Collection[str]) -> str:
    """Return what has to be filled in for a column of a box, and which signals may be it by their unit."""
    what = f" ({MEANING[column]})" if column in MEANING else ""
    may_be = [n for n in part.signals if n not in used and unit_by_name(n, element.si_unit) is not None]
    free = f"; not used yet, in such a unit: {_listed(may_be)}" if may_be else ""
    free += "; a fixed place is `{value: 45, unit: mm}`" if column in POINT else ""
    return f"the signal of '{column}'{what} and its unit, of what is {element.si_unit} in SI{free}"


def _lines(draft: _Draft, part: Part, times_s: FloatArray | None) -> None:
    """Propose what is between samples of a force that moves on there, unless its name says that it was sent."""
    forces = [draft.commands[c] for c in FORCE[:2] if draft.commands.get(c, {}).get("signal", TO_FILL) != TO_FILL]
    names = [entry["signal"] for entry in forces]
    values = [part.signals[name].values for name in names]
    if not names or any(SENT.intersection(words_of(name)) for name in names):
        return
    known = times_s is not None and all(len(v) == len(times_s) for v in values)
    measured = force_noise([[v[np.isfinite(v)]] for v in values]).any()  # noise hides that it moves on
    between = moves_on(values, times_s if known else None)
    if measured and not between.moves_on:
        between = Between.LINE
    if between.moves_on:
        for entry in forces:
            entry["between"] = between.value
        verb = "moves" if len(names) == 1 else "move"
        draft.notes.append(
            f"{_listed(names)}: {verb} on between samples, so the {between.value} between them is taken (between: "
            f"{between.value}); a force that was commanded and held is `between: held`"
        )


def _finished(draft: _Draft, log: Log, clock: ClockGuess, head: dict[str, object]) -> Proposal:
    """Return the proposal once everything but clock and episodes is in the draft."""
    part = log.parts[0]
    used = {u.name for u in draft.used} | clock.names
    channels = {n for entry in draft.channels.values() for n in entry.get("signals") or [entry["signal"]]}
    episodes, said = guess_episodes(log, clock, used, [s for s in draft.used if s.name in channels])
    if said:
        draft.notes.append(said)
    places = [e for e in draft.channels.values() if e.get("quantity") in ("position", "orientation")]
    draft.rests = begins_at_rest(log, [n for e in places for n in e.get("signals") or [e["signal"]]], clock, episodes)
    if draft.noise:
        names = _listed(list(draft.noise))
        draft.notes.append(f"recorded in steps so coarse that noise does not show; stated by rounding: {names}")
    keys = clock.keys(draft.used)
    draft.missing += keys.missing
    draft.notes += [*clock.notes, *keys.notes]
    for name, own in keys.overrides.items():
        for entry in (*draft.commands.values(), *draft.channels.values()):
            if entry.get("signal") == name:
                entry["clock"] = own
    unused = [s for s in part.signals if s not in used | {str(episodes.get("signal"))}]
    if unused:
        more = f" and {len(unused) - SHOWN} more" if len(unused) > SHOWN else ""
        draft.notes.append(f"not used: {', '.join(unused[:SHOWN])}{more}")
    decimal = None if log.decimal == "." else log.decimal
    if decimal is not None:
        draft.notes.append(f"decimal mark of the numbers: {decimal!r}")
    known = {"decimal": decimal, "rate_hz": draft.rate_hz, "sparse": clock.sparse or None}
    logged = {k: v for k, v in known.items() if v is not None}
    above = ({"log": logged} if logged else {}) | ({"clock": keys.clock} if keys.clock is not None else {})
    draft.missing[:0] = _without_unit(draft.unitless)
    return Proposal(_text(draft, above | {"episodes": episodes} | head), draft.table, draft.missing, draft.notes)


def _without_unit(signals: Mapping[str, str]) -> list[str]:
    """Return in one sentence whose unit is missing; of one why, of several that stands beside each."""
    if len(signals) == 1:
        return [f"the unit of '{name}' ({why})" for name, why in signals.items()]
    return [f"the units of {_listed(list(signals))} (why stands beside each)"] if signals else []


def _by_slope(
    draft: _Draft, part: Part, element: Element, signal: Signal, times_s: FloatArray | None
) -> UnitGuess | None:
    """Return the unit of a velocity by the slope of the position of its joint, which stands in the draft already."""
    if element.kind != "joint" or element.quantity != "velocity" or times_s is None:
        return None
    same = {"joint": element.target, "quantity": "position"}
    position = next((c for c in draft.channels.values() if same.items() <= c.items()), None)
    size = None if position is None else UNITS[element.si_unit.removesuffix("/s")].get(position.get("unit", ""))
    values = None if position is None else part.signals[position["signal"]].values
    if size is None or values is None or not len(values) == len(signal) == len(times_s):
        return None
    return unit_by_slope(times_s, values * size, signal.values, element.si_unit)


def _as_the_point(draft: _Draft, part: Part, element: Element, signal: Signal) -> UnitGuess | None:
    """Return the unit of where a box is by that of where the force acts, which its size tells; None: it is not told."""
    point = draft.commands.get(f"p{element.target}", {})
    size = UNITS["m"].get(point.get("unit", ""))
    if (
        element.si_unit != "m"
        or size is None
        or not np.nanmax(np.abs(part.signals[point["signal"]].values), initial=0.0)
    ):
        return None
    within = np.nanmax(np.abs(signal.values), initial=0.0) * size <= MUCH_M
    return UnitGuess(point["unit"], f"in the unit of '{point['signal']}'") if within else None


def _add(
    draft: _Draft, element: Element, signal: Signal, why: str, log: Log, by_another: UnitGuess | None = None
) -> None:
    """Add a command or a channel of one number."""
    group = draft.commands if element.is_command else draft.channels
    column = _free(element.column, {*draft.commands, *draft.channels})
    unit = unit_by_name(signal.name, element.si_unit) or by_another or guess_unit(signal, element, log)
    unit = of_counts(unit, signal, element, log)
    entry: dict = {"signal": signal.name, **element.keys}
    if unit.name is not None:
        entry["unit"] = unit.name
    group[column] = entry
    draft.why[column] = with_unit(why, unit.why)
    draft.used.append(signal)
    unstated = draft.box and column not in NOISE  # there is no place to state the noise of a force
    step = None if element.is_command or unit.name == TO_FILL or unstated else coarse_step(signal.values)
    if step is not None:
        size = allowed(element.si_unit)[unit.name] if unit.name else 1.0
        name = NOISE[column] if draft.box else column
        draft.noise[name] = max(float(f"{step * size / math.sqrt(12):.3g}"), draft.noise.get(name, 0.0))
    draft.table.append((signal.name, element.words, unit.name or "SI", draft.why[column]))
    if unit.name == TO_FILL:
        draft.unitless[signal.name] = unit.why


def _add_pose(draft: _Draft, pose: Pose, part: Part, up: str) -> None:
    for column, entry in pose.channels(up).items():
        name = _free(column, {*draft.commands, *draft.channels})
        draft.channels[name] = entry
        draft.why[name] = pose.why
        names = entry.get("signals") or [entry["signal"]]
        draft.used += [part.signals[n] for n in names]
        draft.table.append(
            (", ".join(names), f"body {pose.body}, {entry['quantity']}", entry.get("unit", "-"), pose.why)
        )
        if entry.get("unit") == TO_FILL:
            draft.unitless[entry["signal"]] = pose.why
        if entry.get("order") == TO_FILL:
            draft.missing.append(f"the order of the quaternion {', '.join(names)}: xyzw or wxyz")


def _only_one_left(draft: _Draft, elements: Sequence[Element], log: Log, used: Collection[str]) -> None:
    """Take the one signal in such a unit that is left for the command of the one actuator that has none."""
    driven = {e["actuator"] for e in draft.commands.values()}
    idle = [e for e in elements if e.is_command and e.target not in driven]
    if len(idle) != 1:
        return
    left = [s for n, s in log.parts[0].signals.items() if n not in used and unit_by_name(n, idle[0].si_unit)]
    if len(left) == 1:
        _add(draft, idle[0], left[0], "the only one in such a unit that is left", log)


def _lacking(draft: _Draft, elements: Sequence[Element]) -> None:
    """Say which actuators have no command, and which joints no position."""
    driven = {e["actuator"] for e in draft.commands.values()}
    measured = {e.get("joint") for e in draft.channels.values() if e.get("quantity") == "position"}
    actuators = [e.target for e in elements if e.is_command]
    joints = [e.target for e in elements if e.kind == "joint" and e.quantity == "position"]
    idle = [a for a in actuators if a not in driven]
    blind = [j for j in joints if j not in measured]
    if actuators and not driven:
        draft.undriven = True
        draft.blank["commands"] = [_blank(e) for e in elements if e.is_command]
        draft.missing.append(
            f"commands: no signal was recognised for actuators {_listed(actuators)}; {{}} if nothing was sent to them"
        )
    elif idle:
        draft.notes.append(f"no command for {_listed(idle)}: such an actuator gets 0")
    if not draft.channels:
        draft.blank["channels"] = [_blank(e) for e in elements if (e.kind, e.quantity) == ("joint", "position")]
        what = f"joints {_listed(joints)}" if joints else "the pose of a body"
        draft.missing.append(f"channels: no signal was recognised for {what}")
    elif blind:
        draft.notes.append(f"no position for joints {_listed(blind)}")


def _blank(element: Element) -> str:
    """Return a line of a map for an element whose signal is not known."""
    column, unit = _free(element.column, set()), {"unit": element.si_unit} if element.si_unit else {}
    return f"  # {column}: {_flow({'signal': TO_FILL, **element.keys, **unit})}"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(repr, names[:SHOWN])) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")


def _free(wanted: str, taken: set[str]) -> str:
    name = "".join(c if c.isalnum() or c == "_" else "_" for c in wanted)
    name = name if COLUMN.fullmatch(name) and name not in TAKEN else f"c_{name}"
    free, number = name, 2
    while free in taken:
        free, number = f"{name}_{number}", number + 1
    return free


def _text(draft: _Draft, head: Mapping[str, object]) -> str:
    """Return the YAML, with what was recognised beside every line."""
    lines = ["# Proposed from names, sizes and ranges: check every line. docs/importing.md explains the keys."]
    if draft.missing:
        lines += [f"# {TO_FILL}: {sentence}." for sentence in draft.missing]
    lines += [f"{key}: {_flow(value)}" for key, value in head.items()]
    for title, entries, empty in (
        ("commands", draft.commands, "  # u_joint: {signal: NAME, actuator: NAME, unit: rad}"),
        ("channels", draft.channels, "  # q_joint: {signal: NAME, joint: NAME, quantity: position, unit: rad}"),
    ):
        if not entries:
            lines.append(f"{title}: {'{}' if title == 'commands' and not draft.undriven else TO_FILL}")
            lines += draft.blank.get(title) or [empty]
            continue
        lines.append(f"{title}:")
        lines += [f"  {name}: {_flow(entry)}  # {' '.join(draft.why[name].split())}" for name, entry in entries.items()]

    rounding = "here step / sqrt(12) of coarse ones; " if draft.noise else ""
    known = f"standard deviations in SI, as far as known: answers are surer; {rounding}else estimated"
    lines.append(f"noise: {_flow(draft.noise)}  # {known}")
    if not draft.box:
        unseen = "nothing shows that" if draft.channels else "no channel was recognised that would show whether"
        free = f"start: free  # {unseen} every episode begins at rest; if they all do: rest"
        lines.append(
            "start: rest  # every episode begins far slower than it goes on; else free" if draft.rests else free
        )
    return "\n".join([*lines, ""])


def _flow(value: object) -> str:
    if not isinstance(value, dict | list):
        return str(value)
    return yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000).strip()
