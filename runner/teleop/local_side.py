"""The local side of a run: at every update it estimates, writes the new values, and takes over the remote's state.

This is the direct way, for messages that arrive at once; where states are late, uncertain or held back,
`runner.teleop.late_side` does the updates.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from runner.physics import dry_friction
from runner.physics.scene import BodyHandle
from runner.teleop.estimators import Cuts, Outcome, Seen
from runner.teleop.parameters import ModelArrays, writer
from runner.teleop.run_record import RunRecord

State = tuple[list[float], list[float]]  # all positions and velocities of a run
Learn = Callable[[tuple[Any, ...], State, State], bool]


def learner(record: RunRecord, qpos: np.ndarray, qvel: np.ndarray, numbers: ModelArrays) -> Learn:
    """Return the function that lets every estimator of a run update and writes the new values into its model.

    It is given what is known of the tick (see `RunRecord.known`), the state now, and the state that was received, and
    returns whether a value has changed. A closure, as this is what a run spends its time on besides the physics.
    """
    handles, setup = record.handles, record.setup
    remote_cuts = cuts_of(handles[0])
    rules = list(record.experiment.estimator.values())
    lanes = [
        (j, rule.update, rule.values, writer(rule.names, numbers, handles[j + 1].body_id, setup.body),
         cuts_of(handles[j + 1]), record.memories[j].append, record.outcomes[j].append)
        for j, rule in enumerate(rules)
    ]  # fmt: skip
    memories = [rule.start(setup) for rule in rules]
    common = qpos.tolist(), qvel.tolist()
    new = tuple.__new__  # what `Seen(...)` calls, without the detour

    def learn(tick: tuple[Any, ...], state: State, taken: State) -> bool:
        nonlocal common
        number, message, _, now, sent, since, impulse = tick
        record.count = number + 1
        if message < 0:
            for j, _, _, _, _, remember, report in lanes:
                remember(memories[j])
                report(Outcome.no_message)
            return False
        changed = False
        for j, step, values, write, local_cuts, remember, report in lanes:
            old = memories[j]
            seen = new(Seen, (now, sent, since, impulse, *state, *taken, *common, local_cuts, remote_cuts))
            memory, outcome = step(old, seen)
            remember(memory)
            report(outcome)
            if memory is not old:
                memories[j] = memory
                changed = True
                write(values(memory))
        common = taken
        return changed

    return learn


def local_side(record: RunRecord, qpos: np.ndarray, qvel: np.ndarray, numbers: ModelArrays) -> Callable[[], bool]:
    """Return the function that does one update of a run, on live views of its state and its model's numbers.

    It takes in what has arrived, lets every estimator update, writes the new values, and sets the local cubes to the
    remote's state. It returns whether a value has changed.
    """
    learn = learner(record, qpos, qvel, numbers)
    views = [(qpos[h.qpos_adr : h.qpos_adr + h.nq], qvel[h.dof_adr : h.dof_adr + h.nv]) for h in record.handles]
    (remote_q, remote_v), locals_ = views[0], views[1:]
    where_q, along, turning = cuts_of(record.handles[0])
    where_v = slice(along.start, turning.stop)
    sent_q, sent_v, known, received = record.qpos, record.qvel, iter(record.known), record.received
    positions, velocities = qpos.tolist, qvel.tolist

    def update() -> bool:
        tick = next(known)
        number, message, fresh = tick[:3]
        sent_q[number] = qpos
        sent_v[number] = qvel
        state = positions(), velocities()
        taken: Any = state if fresh or message < 0 else tuple(part.tolist() for part in received(message))
        changed = learn(tick, state, taken)
        if fresh:
            for local_q, local_v in locals_:
                local_q[:] = remote_q
                local_v[:] = remote_v
        elif message >= 0:
            for local_q, local_v in locals_:
                local_q[:] = taken[0][where_q]
                local_v[:] = taken[1][where_v]
        return changed

    return update


def cuts_of(handle: BodyHandle) -> Cuts:
    """Where a body's position, linear and angular velocity stand in qpos and qvel."""
    turning = 3 if handle.joints == dry_friction.FREE else 1
    v = handle.dof_adr
    return (
        slice(handle.qpos_adr, handle.qpos_adr + handle.nq),
        slice(v, v + handle.nv - turning),
        slice(v + handle.nv - turning, v + handle.nv),
    )
