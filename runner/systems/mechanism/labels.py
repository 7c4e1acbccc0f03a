"""What a mechanism was doing in a stretch of time: from commands and measurements alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from runner.effects.mechanism import Scope
from runner.effects.wording import DEGREES
from runner.numerics.arrays import FloatArray
from runner.recording import Span
from runner.recording.model_form import MechanismRecording
from runner.recording.model_form_mapping import AT_JOINT, is_servo
from runner.settings import SETTINGS
from runner.systems.channels import Signals
from runner.systems.mechanism.coordinates import BALL, FREE, HINGE, SLIDE
from runner.systems.mechanism.initial import MechanismStart
from runner.systems.mechanism.models import Models
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.windows import Labels, Windows

REGIMES = (
    "at rest",
    "breakaway",
    "reversal",
    "saturated",
    "free swing",
    "driven",
    "just after a change of command",
    "in flight",
    "at an impact",
    "in contact",
)
PHRASES = {
    "breakaway": "when a joint breaks away",
    "reversal": "when a joint turns round",
    "saturated": "when an actuator is saturated",
    "free swing": "in free swing",
    "driven": "when driven",
    "in flight": "in flight",
    "at an impact": "at an impact",
    "in contact": "in contact after an impact",
}
FACTORS = {
    "regime": "{}",
    "moving joint": "when {} moves most",
    "direction": "when {}",
    "position": "with {}",
    "speed": "at {}",
    "load": "under {}",
    "time": "in {} of an episode",
    "episode": "in {}",
}
THIRDS = ("low", "middle", "high")
# along x, y and z, forth and back
WAYS = (("along x", "against x"), ("along y", "against y"), ("up", "down"))
# where a joint is, from here to there
AT = {HINGE: "at {} to {}°", SLIDE: "at {} to {} m", BALL: "turned by {} to {}°", FREE: "at a height of {} to {} m"}


@dataclass(frozen=True)
class _Motion:
    """All joints at the begin, middle and end of each window: positions and speeds, (W, 3, J).

    For a reader each has a name, `called`, a place in his unit, (W, 3, J), as it is said by `at`, and the way on which
    it is in the middle of a window, (W, J): of a body in space how high it is, and along which axis it moves.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    position: FloatArray
    speed: FloatArray
    called: tuple[str, ...]
    at: tuple[str, ...]
    place: FloatArray
    way: np.ndarray


def label(
    recording: MechanismRecording,
    models: Models,
    initial: MechanismStart,
    scope: Scope,
    signals: Signals,
    windows: Windows,
    flights: Sequence[Sequence[Span]] = (),
) -> Labels:
    """Return what went on in each window, and the factors that windows are sorted by.

    Args:
        recording: The case.
        models: Its models.
        initial: Of the recording.
        scope: What is known of the mechanism.
        signals: What was measured.
        windows: W of them.
        flights: When free bodies touch nothing, for each episode; none of what hits nothing, and of anything else.
    """
    motion = _motion(initial, signals, windows, models.qpos0)
    seen = np.sqrt(np.mean(motion.speed**2, axis=(0, 1)))
    usual = np.array([max(scope.speed.get(n, v), 1e-9) for n, v in zip(motion.names, seen, strict=True)])
    share = motion.speed / usual
    count, rows = len(windows), np.arange(len(windows))
    most = np.argmax(np.abs(share).max(axis=1), axis=1) if motion.names else np.zeros(count, int)
    steps = windows.samples - 1
    error = initial.speed_error(signals.sigma)[[initial.coordinates.by_name[n].v.start for n in motion.names]]
    still = np.abs(share) < np.maximum(MECHANISM.signal.slow, MECHANISM.signal.still_errors * error / usual)
    rest = np.asarray(still.all(axis=(1, 2)))
    breakaway = (still[:, 0] & ~still[:, 2]).any(axis=1)
    turned = ((share[:, 0] * share[:, 2] < 0) & ~still[:, 0] & ~still[:, 2]).any(axis=1)
    sent = windows.of([e.commands for e in recording.episodes])[:, :-1]
    saturated, idle, load = _actuation(recording, models, scope, sent, windows, initial, motion)
    after = _after_change(recording, scope, windows)
    regime = np.select(
        [after, saturated, rest, breakaway, turned, idle],
        [REGIMES[i] for i in (6, 3, 0, 1, 2, 4)],
        REGIMES[5],
    )
    if all(joint.kind == FREE for joint in initial.coordinates.joints):
        # what has nothing to hit has no flights that end
        at = _touching(flights, windows) if any(flights) else REGIMES[7]
        regime = np.where(regime == REGIMES[4], at, regime)
    middle = windows.first + steps / 2
    lengths = np.array([len(recording.episodes[e]) for e in windows.episode])
    quarter = np.minimum(4 * middle / lengths, 3).astype(int)
    moves = np.logical_not(rest)
    table = pd.DataFrame(
        {
            "episode": [f"episode {recording.episodes[e].index}" for e in windows.episode],
            "t_s": [
                float(np.interp(m, np.arange(len(recording.episodes[e])), recording.episodes[e].t_s))
                for e, m in zip(windows.episode, middle, strict=True)
            ],
            "regime": regime,
            "moving joint": _where(moves, [f"'{motion.called[j]}'" for j in most]),
            "direction": _where(
                moves, [way[j] and f"'{motion.called[j]}' {way[j]}" for way, j in zip(motion.way, most, strict=True)]
            ),
            "position": _thirds(motion, most, moves),
            "speed": _thirds_of_speed(np.abs(share[rows, 1, most]), moves, _usual(motion, usual)),
            "load": load,
            "time": np.array([f"the {q} quarter" for q in ("first", "second", "third", "last")])[quarter],
        }
    )
    for j, (name, unit) in enumerate(zip(motion.names, motion.units, strict=True)):
        suffix = unit.replace(" ", "_")
        table[f"{name}_{suffix}"] = motion.position[:, 1, j]
        table[f"{name}_{suffix}_s"] = motion.speed[:, 1, j]
    return Labels(table)


def _touching(flights: Sequence[Sequence[Span]], windows: Windows) -> np.ndarray:
    """Return whether bodies fly, hit something or have done so in each window, (W,)."""
    out = np.full(len(windows), REGIMES[9], dtype=object)
    for w, (e, first) in enumerate(zip(windows.episode, windows.first, strict=True)):
        last = first + windows.samples - 1
        for span in flights[e]:
            if first >= span.begin and last < span.end:
                out[w] = REGIMES[7]
            elif first < span.end <= last:
                out[w] = REGIMES[8]
    return out


def _where(moves: np.ndarray, names: Sequence[str | None]) -> np.ndarray:
    return np.array([n if m else None for n, m in zip(names, moves, strict=True)], dtype=object)


def _motion(initial: MechanismStart, signals: Signals, windows: Windows, qpos0: FloatArray) -> _Motion:
    """Return how joints move; of one with several degrees of freedom how far it is from its reference, and how fast."""
    coordinates = initial.coordinates
    states = np.stack(
        [
            initial.guess_windows(signals, Windows(windows.episode, windows.first + shift, 1), smooth=True)
            for shift in (0, (windows.samples - 1) // 2, windows.samples - 1)
        ],
        axis=1,
    )
    away, rates = states[..., : coordinates.nv], states[..., coordinates.nv :]
    position, speed, place, way = [], [], [], []
    for joint in coordinates.joints:
        first = slice(joint.v.start, joint.v.start + 3)
        if joint.kind in (HINGE, SLIDE):
            position.append(qpos0[joint.q.start] + away[..., joint.v.start])
            speed.append(rates[..., joint.v.start])
            way.append(["moves up" if v > 0 else "moves down" for v in speed[-1][:, 1]])
        else:
            position.append(np.linalg.norm(away[..., first], axis=-1))
            speed.append(np.linalg.norm(rates[..., first], axis=-1))
            way.append([_way(v) if joint.kind == FREE else None for v in rates[:, 1, first]])
        if joint.kind == FREE:
            place.append(qpos0[joint.q.start + 2] + away[..., joint.v.start + 2])
        else:
            place.append((1.0 if joint.kind == SLIDE else DEGREES) * position[-1])
    return _Motion(
        tuple(j.name for j in coordinates.joints),
        tuple("m" if j.kind in (SLIDE, FREE) else "rad" for j in coordinates.joints),
        np.stack(position, axis=-1),
        np.stack(speed, axis=-1),
        tuple(j.called for j in coordinates.joints),
        tuple(AT[j.kind] for j in coordinates.joints),
        np.stack(place, axis=-1),
        np.array(way, dtype=object).T,
    )


def _way(velocity: FloatArray) -> str:
    """Return along which axis a body in space moves most, in words."""
    axis = int(np.argmax(np.abs(velocity)))
    forth, back = WAYS[axis]
    return f"moves {forth if velocity[axis] > 0 else back}"


def _after_change(recording: MechanismRecording, scope: Scope, windows: Windows) -> np.ndarray:
    """Return whether a command has just changed, (W,)."""
    largest = np.array([max(scope.command[c.actuator], 1e-12) for c in recording.mapping.commands.values()])
    changed = []
    for episode in recording.episodes:
        # an episode begins with a change from what was commanded before
        jumps = (
            np.abs(np.diff(episode.commands, axis=0, prepend=episode.commands[:1]))
            > SETTINGS.where.command_change * largest
        )
        changed.append(jumps.any(axis=1))
    back = round(SETTINGS.where.just_after_s / recording.step_s)
    steps = windows.samples - 1
    return np.array(
        [changed[e][max(0, f - back) : f + steps].any() for e, f in zip(windows.episode, windows.first, strict=True)],
        bool,
    )


def _actuation(
    recording: MechanismRecording,
    models: Models,
    scope: Scope,
    sent: FloatArray,
    windows: Windows,
    initial: MechanismStart,
    motion: _Motion,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return whether an actuator is saturated, whether none drives, and how hard the hardest drives, each (W,).

    Args:
        recording: The case.
        models: Its models.
        scope: How far commands went.
        sent: Commands in each window, (W, n, K).
        windows: W of them.
        initial: Of the recording.
        motion: Positions and speeds of the joints.
    """
    model = models.compiled(()).model
    count = len(windows)
    saturated, idle, effort = np.zeros(count, bool), np.ones(count, bool), np.zeros(count)
    for k, target in enumerate(recording.mapping.commands.values()):
        a = model.actuator(target.actuator).id
        size = np.abs(sent[..., k]).mean(axis=1)
        force = size
        limit = np.inf
        if model.actuator_forcelimited[a]:
            limit = float(np.abs(model.actuator_forcerange[a]).max())
        if is_servo(model, a) and int(model.actuator_trntype[a]) in AT_JOINT:
            name = model.joint(int(model.actuator_trnid[a, 0])).name
            j = motion.names.index(name)
            gear, bias = model.actuator_gear[a, 0], model.actuator_biasprm[a]
            here, rate = motion.position[:, 1, j] * gear, motion.speed[:, 1, j] * gear
            force = np.abs(model.actuator_gainprm[a, 0] * sent[..., k].mean(axis=1) + bias[1] * here + bias[2] * rate)
            idle[:] = False
        else:
            idle &= size < MECHANISM.signal.idle * max(scope.command[target.actuator], 1e-12)
            force = np.abs(model.actuator_gainprm[a, 0]) * size
        saturated |= force >= MECHANISM.signal.saturated * limit
        if model.actuator_ctrllimited[a] and not is_servo(model, a):
            saturated |= size >= MECHANISM.signal.saturated * float(np.abs(model.actuator_ctrlrange[a]).max())
        usual = float(np.sqrt(np.mean(force**2))) if count else 0.0
        effort = np.maximum(effort, force / usual if usual > 0 else 0.0)
    named = np.full(count, None, dtype=object)
    if count >= 6 and len(recording.mapping.commands):
        edges = np.quantile(effort, [1 / 3, 2 / 3])
        words = ("little load", "a middling load", "a high load")
        named = np.array([words[i] for i in np.searchsorted(edges, effort)], dtype=object)
    for i in range(len(recording.mapping.forces)):
        sizes = [np.linalg.norm(e.forces_n[:, i], axis=1) for e in recording.episodes]
        idle &= windows.of(sizes).mean(axis=1) < MECHANISM.signal.idle * max(float(s.max()) for s in sizes)
    return saturated, idle, named


def _thirds(motion: _Motion, most: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return in which third of its range the joint that moves most is, (W,)."""
    out = np.full(len(most), None, dtype=object)
    for j, (name, at) in enumerate(zip(motion.called, motion.at, strict=True)):
        here = moves & (most == j)
        if not here.any():
            continue
        place = motion.place[..., j]
        edges = np.linspace(place.min(), place.max(), 4)
        third = np.clip(np.searchsorted(edges, place[here, 1], side="right") - 1, 0, 2)
        said = [f"'{name}' {at.format(f'{a:.3g}', f'{b:.3g}')}" for a, b in pairwise(edges)]
        out[here] = [said[i] for i in third]
    return out


def _usual(motion: _Motion, usual: FloatArray) -> str:
    """Return the usual speed of joints, (J,), in words: of one or two each, of more the least and the largest."""
    each = [f"{v:.2g} {unit}/s of '{n}'" for v, unit, n in zip(usual, motion.units, motion.called, strict=True)]
    if len(each) <= 2:
        return " or ".join(each)
    out = []
    for unit in dict.fromkeys(motion.units):
        of = [v for v, u in zip(usual, motion.units, strict=True) if u == unit]
        out.append(f"{min(of):.2g} to {max(of):.2g} {unit}/s" if len(of) > 1 else f"{of[0]:.2g} {unit}/s")
    return f"{' or '.join(out)} of its joint"


def _thirds_of_speed(share: FloatArray, moves: np.ndarray, usual: str) -> np.ndarray:
    """Return how fast the joint that moves most is, in words with its share of the usual speed, (W,).

    Args:
        share: Of the usual speed, (W,).
        moves: Whether anything moves, (W,).
        usual: What that speed is, in words.
    """
    out = np.full(len(share), None, dtype=object)
    if moves.sum() >= 6:
        edges = np.quantile(share[moves], [0, 1 / 3, 2 / 3, 1])
        third = np.clip(np.searchsorted(edges, share[moves], side="right") - 1, 0, 2)
        _, a, b, _ = edges
        within = (f"up to {a:.2g}", f"{a:.2g} to {b:.2g}", f"more than {b:.2g}")
        said = [f"{name} speed ({which} times the usual {usual})" for name, which in zip(THIRDS, within, strict=True)]
        out[moves] = [said[i] for i in third]
    return out
