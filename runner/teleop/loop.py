"""The closed loop: step both cubes, take in what the link delivers, estimate, take over the remote's state, record.

This is the only caller of `physics.step()`. `run` does one experiment on dm-control's physics, `run_batch` many at
once on `mujoco.batch.Batch`; both give the same bits. Nothing that looks at a run (logs, figures, tables) takes part
in it: the loop keeps raw numbers, and makes frames of them when it is over.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control.rl.control import PhysicsError
from mujoco.batch import MODEL_FIELDS, Batch, SimulationError

from runner.physics import dry_friction
from runner.physics.scene import Body as Handle
from runner.teleop.estimators import Cuts, Outcome, Seen, Setup
from runner.teleop.experiment import (
    REMOTE,
    Commands,
    Experiment,
    World,
    build_world,
    commands,
    compile_key,
    handles_of,
    scene_of,
    set_numbers,
    set_start,
    tape_of,
    truth_of,
    warning_text,
)
from runner.teleop.follow import ALL, Difference, Immediate, Unaware
from runner.teleop.frames import Frames, RunResult, Status, Truth
from runner.teleop.latency import Resimulation
from runner.teleop.link import newest, schedule, update_steps
from runner.teleop.parameters import MASS, Numbers, sizes, writer

Advance = Callable[[int], object]


def _silent(_: int) -> None:
    """Report progress to nobody."""


def _ticks(
    message: np.ndarray, experiment: Experiment, given: Commands, ends: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return for each tick the tick before at which a message was taken in, and the impulse commanded since then.

    Returns:
        The tick before, -1: the start, (m,); the impulse, (m, 3), N s.
    """
    h = experiment.scene.timestep_s
    taken = np.maximum.accumulate(np.where(message >= 0, np.arange(len(ends)), -1))
    since = np.concatenate([[-1], taken[:-1]]) if len(ends) else taken
    total = np.vstack([np.cumsum(given.force_n, axis=0)[ends - 1] * h, np.zeros(3)])  # row -1: the start
    return since, total[:-1] - total[since]


class Record:
    """What is known of a run before it, and what its updates leave behind.

    Attributes:
        ends: After how many steps each tick comes, (m,).
        taken: The messages that are taken in at each tick, by the ticks at which they were sent, in that order.
        message: The newest of them, -1: none, (m,).
        noise: On what each message says of the remote, (m, 2 nv of it); None: none.
        fresh: Whether whatever arrives does so at once, and true.
        known: For each tick: its number, the message, whether it was sent at this very tick, the time, the time at
            which it was sent, the time since when, and the impulse since then.
        count: Ticks so far.
        qpos, qvel: Of all cubes at each tick, before the locals take over the remote's state, (m, nq), (m, nv).
        memories: Per estimator, its memory after each tick.
        outcomes: Per estimator, what it did at each tick.
        shown: Per estimator, the values that its shown cube had after each tick; empty where those of the estimate.
    """

    def __init__(self, experiment: Experiment, handles: Sequence[Handle], given: Commands) -> None:
        self.experiment, self.handles, self.commands = experiment, handles, given
        # the pushes of the locals: the nominal ones
        self.setup = Setup(
            experiment.scene, experiment.local, given.pushes[:-1, dry_friction.PUSH_SIZE : 2 * dry_friction.PUSH_SIZE]
        )
        self.nq, self.nv = sum(h.nq for h in handles), sum(h.nv for h in handles)
        h = experiment.scene.timestep_s
        self.ends = update_steps(experiment.link, h, experiment.steps)
        times = np.append(self.ends * h, 0.0)  # the last: the start
        self.taken = schedule(experiment.link, times[:-1], np.random.default_rng([experiment.seed, 1]))
        self.message = newest(self.taken)
        since, impulse = _ticks(self.message, experiment, given, self.ends)
        number = np.arange(len(self.ends))
        self.noise = self._draw_noise()
        at_once = (self.message == number) & (self.noise is None)
        columns = (number, self.message, at_once, times[:-1], times[self.message], times[since], impulse)
        self.fresh = self.noise is None and bool(((self.message < 0) | (self.message == number)).all())
        self.known = list(zip(*(c.tolist() for c in columns), strict=True))
        self.count = 0
        self.qpos, self.qvel = np.empty((len(number), self.nq)), np.empty((len(number), self.nv))
        self.memories: list[list[Any]] = [[] for _ in experiment.estimator]
        self.outcomes: list[list[int]] = [[] for _ in experiment.estimator]
        self.shown: list[list[Any]] = [[] for _ in experiment.estimator]

    def _draw_noise(self) -> np.ndarray | None:
        link, remote = self.experiment.link, self.handles[0]
        angular = 3 if remote.joints == dry_friction.FREE else 1
        rng = np.random.default_rng([self.experiment.seed, 2])
        return link.noise.draws(len(self.ends), remote.nv - angular, angular, rng) if link.noise else None

    def received(self, message: int) -> tuple[np.ndarray, np.ndarray]:
        """Return what a message says, in place of all positions (nq,) and velocities (nv,): the remote's with noise."""
        q, v, remote = self.qpos[message].copy(), self.qvel[message].copy(), self.handles[0]
        if self.noise is not None:
            along, of_velocity = np.split(self.noise[message], 2)
            remote.move(q[remote.qpos_adr : remote.qpos_adr + remote.nq], along)
            v[remote.dof_adr : remote.dof_adr + remote.nv] += of_velocity
        return q, v


State = tuple[list[float], list[float]]  # all positions and velocities of a run
Learn = Callable[[tuple[Any, ...], State, State], bool]


def learner(record: Record, qpos: np.ndarray, qvel: np.ndarray, numbers: Numbers) -> Learn:
    """Return the function that lets every estimator of a run update and writes the new values into its model.

    It is given what is known of the tick (see `Record.known`), the state now, and the state that was received, and
    returns whether a value has changed. A closure, as this is what a run spends its time on besides the physics.
    """
    handles, setup = record.handles, record.setup
    remote_cuts = _cuts(handles[0])
    rules = list(record.experiment.estimator.values())
    lanes = [
        (j, rule.update, rule.values, writer(rule.names, numbers, handles[j + 1].body_id, setup.body),
         _cuts(handles[j + 1]), record.memories[j].append, record.outcomes[j].append)
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


def local_side(record: Record, qpos: np.ndarray, qvel: np.ndarray, numbers: Numbers) -> Callable[[], bool]:
    """Return the function that does one update of a run, on live views of its state and its model's numbers.

    It takes in what has arrived, lets every estimator update, writes the new values, and sets the local cubes to the
    remote's state. It returns whether a value has changed.
    """
    learn = learner(record, qpos, qvel, numbers)
    views = [(qpos[h.qpos_adr : h.qpos_adr + h.nq], qvel[h.dof_adr : h.dof_adr + h.nv]) for h in record.handles]
    (remote_q, remote_v), locals_ = views[0], views[1:]
    where_q, along, turning = _cuts(record.handles[0])
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


class InStep:
    """The updates of many runs whose ticks come together and whose messages arrive at once, done for all at once.

    What `local_side` does run by run, in fewer calls: states are kept, and taken over, in whole tables. The bits are
    the same, as nothing is computed but by the estimators.

    Args:
        records: Of all runs.
        qpos, qvel: Live states of all runs, (n, nq), (n, nv).
        numbers: Of all runs.
    """

    def __init__(
        self, records: Sequence[Record], qpos: np.ndarray, qvel: np.ndarray, numbers: Sequence[Numbers]
    ) -> None:
        self.qpos, self.qvel = qpos, qvel
        self.known = [record.known for record in records]
        self.learn = [learner(*one) for one in zip(records, qpos, qvel, numbers, strict=True)]
        ticks = max(len(record.ends) for record in records)
        self.kept_q, self.kept_v = np.empty((ticks, *qpos.shape)), np.empty((ticks, *qvel.shape))
        for i, record in enumerate(records):
            m = len(record.ends)
            record.qpos, record.qvel = self.kept_q[:m, i], self.kept_v[:m, i]
        remote, *locals_ = records[0].handles
        self.remote = remote.qpos_adr, remote.dof_adr, remote.nq, remote.nv
        self.locals = [(local.qpos_adr, local.dof_adr) for local in locals_]

    @staticmethod
    def serves(records: Sequence[Record]) -> bool:
        """Tell whether runs tick together, and all messages arrive at once and are true."""
        first = records[0]
        return all(
            _side(r) is local_side
            and r.fresh
            and bool((r.message >= 0).all())
            and len(r.handles) == len(first.handles)
            and np.array_equal(r.ends[: len(first.ends)], first.ends[: len(r.ends)])
            for r in records
        )

    def update(self, number: int, ids: Sequence[int]) -> list[int]:
        """Do one update of some runs, and return those in which a value has changed."""
        if not ids:
            return []
        qpos, qvel = self.qpos, self.qvel
        rows: Any = slice(None) if len(ids) == len(qpos) else ids
        self.kept_q[number, rows], self.kept_v[number, rows] = qpos[rows], qvel[rows]
        positions, velocities, known, learn = qpos.tolist(), qvel.tolist(), self.known, self.learn
        changed = []
        for i in ids:
            state = positions[i], velocities[i]
            if learn[i](known[i][number], state, state):
                changed.append(i)
        q, v, nq, nv = self.remote
        for local_q, local_v in self.locals:
            qpos[rows, local_q : local_q + nq] = qpos[rows, q : q + nq]
            qvel[rows, local_v : local_v + nv] = qvel[rows, v : v + nv]
        return changed


def late_side(record: Record, qpos: np.ndarray, qvel: np.ndarray, numbers: Numbers) -> Callable[[], bool]:
    """Return what `local_side` returns, for states that are old, or uncertain, or not taken over at once.

    The estimate is made in a simulation of its own, see `teleop.latency`. The local cubes of the run are what the
    operator is shown: they follow it by the policy, and have no part in the estimate.
    """
    experiment, own = record.experiment, Resimulation(record.experiment, record.commands)
    h = experiment.scene.timestep_s
    remote, shown = record.handles[0], record.handles[1:]
    _, linear, _ = remote_cuts = _cuts(remote)
    at_v = slice(remote.dof_adr, remote.dof_adr + remote.nv)
    straight = linear.stop - linear.start
    total = np.vstack([np.zeros(3), np.cumsum(record.commands.force_n, axis=0) * h])
    rules = list(experiment.estimator.values())
    memories = [rule.start(record.setup) for rule in rules]
    writers = [
        [writer(rule.names, n, handles[j].body_id, experiment.local) for j, rule in enumerate(rules)]
        for n, handles in ((Numbers.of(own.model), own.handles), (numbers, shown))
    ]
    values = [np.array(rule.values(memory)) for rule, memory in zip(rules, memories, strict=True)]
    given = [value.copy() for value in values]  # to the shown cubes
    common, common_step, number, before = (qpos.tolist(), qvel.tolist()), 0, -1, 0

    def take_in(message: int) -> None:
        nonlocal common, common_step
        step = int(record.ends[message])
        q, v = own.state(step)
        state, said = (q.tolist(), v.tolist()), record.received(message)
        taken = said[0].tolist(), said[1].tolist()
        impulse = (total[step] - total[common_step]).tolist()
        for j, rule in enumerate(rules):
            seen = Seen(
                now * h, step * h, common_step * h, impulse, *state, *taken, *common, _cuts(own.handles[j]), remote_cuts
            )
            memory, outcome = rule.update(memories[j], seen)
            outcomes[j] = outcome
            if memory is not memories[j]:
                memories[j] = memory
                values[j] = np.array(rule.values(memory))
                writers[0][j](values[j])
                own.set_parameters()
        own.restart(step, said[0][remote_cuts[0]], said[1][at_v])
        common, common_step = taken, step

    def follow(j: int) -> bool:
        local, best = shown[j], own.handles[j]
        best_q, best_v = (
            best_state[0][best.qpos_adr : best.qpos_adr + best.nq],
            best_state[1][best.dof_adr :][: best.nv],
        )
        shown_q, shown_v = qpos[local.qpos_adr : local.qpos_adr + local.nq], qvel[local.dof_adr :][: local.nv]
        dq, dv, dp = local.difference(shown_q, best_q), best_v - shown_v, values[j] - given[j]
        share = experiment.follow.share(
            Difference(
                position_m=_size(dq[:straight]),
                angle_rad=_size(dq[straight:]),
                velocity_m_s=_size(dv[:straight]),
                rate_rad_s=_size(dv[straight:]),
                parameters=float(np.max(np.abs(dp / sizes(rules[j].names, experiment.local, given[j])))),
                speed_m_s=_size(best_v[:straight]),
                turning_rad_s=_size(best_v[straight:]),
                pushed=bool(record.commands.force_n[before:now].any()),
                interval_s=(now - before) * h,
            )
        )
        if share == ALL:
            shown_q[:], shown_v[:] = best_q, best_v
        else:
            local.move(shown_q, np.repeat(share[:2], (straight, len(dq) - straight)) * dq)
            shown_v += np.repeat(share[2:4], (straight, len(dv) - straight)) * dv
        if share.parameters == 0.0 or not dp.any():
            return False
        given[j] = values[j].copy() if share.parameters == 1.0 else given[j] + share.parameters * dp
        writers[1][j](given[j])
        return True

    def update() -> bool:
        nonlocal number, now, before, best_state
        number += 1
        record.count, now = number + 1, int(record.ends[number])
        record.qpos[number], record.qvel[number] = qpos, qvel
        outcomes[:] = [Outcome.no_message] * len(rules)
        for message in record.taken[number]:
            take_in(message)
        best_state = own.state(now)
        changed = [follow(j) for j in range(len(rules))]
        for j in range(len(rules)):
            record.memories[j].append(memories[j])
            record.outcomes[j].append(outcomes[j])
            record.shown[j].append(tuple(given[j].tolist()))
        before = now
        return any(changed)

    now, outcomes = 0, [Outcome.no_message] * len(rules)
    best_state = own.state(0)
    return update


def _size(vector: np.ndarray) -> float:
    return float(np.linalg.norm(vector))


def _side(record: Record) -> Callable[..., Callable[[], bool]]:
    """Return what does the updates of a run: the direct way where nothing is late, uncertain or held back."""
    follow = record.experiment.follow
    direct = isinstance(follow, Unaware) or (record.fresh and isinstance(follow, Immediate))
    return local_side if direct else late_side


def _cuts(handle: Handle) -> Cuts:
    """Where a body's position, linear and angular velocity stand in qpos and qvel."""
    turning = 3 if handle.joints == dry_friction.FREE else 1
    v = handle.dof_adr
    return (
        slice(handle.qpos_adr, handle.qpos_adr + handle.nq),
        slice(v, v + handle.nv - turning),
        slice(v + handle.nv - turning, v + handle.nv),
    )


def run(experiment: Experiment, advance: Advance = _silent) -> RunResult:
    """Run one experiment on dm-control's physics.

    Args:
        experiment: What to run.
        advance: Called with the number of steps since its last call, now and then, for a progress bar.
    """
    return run_world(experiment, build_world(experiment), advance)


def run_world(experiment: Experiment, world: World, advance: Advance = _silent) -> RunResult:
    """Run an experiment on a world that was built for it; the world starts afresh, whatever was done with it."""
    world.physics.reset()
    set_start(experiment, world.model, world.scratch)
    given = commands(experiment)
    model, data = world.model, world.data
    record = Record(experiment, world.handles, given)
    update = _side(record)(record, data.qpos, data.qvel, Numbers.of(model))
    reel = world.tape.wind(data.userdata, given.pushes)
    done, reason = 0, ""
    step, set_const, scratch = world.physics.step, mujoco.mj_setConst, world.scratch
    begin = time.perf_counter()
    try:
        for end in record.ends.tolist():
            step(end - done)
            done = end
            if update():
                set_const(model, scratch)
            if not done % 512:
                advance(512)
        step(experiment.steps - done)
        done = experiment.steps
    except PhysicsError as error:
        reason = f"{' '.join(str(error).split())} after {done * experiment.scene.timestep_s:g} s"
    finally:
        reel.unwind()
    wall_s = time.perf_counter() - begin
    return _result(record, world.truth, reel.frames[:done], wall_s, reason)


def run_batch(experiments: Sequence[Experiment], *, threads: int = 0, advance: Advance = _silent) -> list[RunResult]:
    """Run many experiments at once; each gives the same bits as `run` does.

    Those that share a time step, an update rate, and the number of estimators run together in one
    `mujoco.batch.Batch`; a mixture is split into as many as it takes.

    Args:
        experiments: What to run.
        threads: Of the batch; 0: one per core.
        advance: Called with the number of physics steps since its last call, over all runs.
    """
    groups: dict[str, list[int]] = {}
    for i, e in enumerate(experiments):
        key = repr((e.scene, e.link.rate_hz, len(e.estimator), [x for x in e.remote.effects.values() if x.structural]))
        groups.setdefault(key, []).append(i)
    out: dict[int, RunResult] = {}
    for members in groups.values():
        results = _run_group([experiments[i] for i in members], threads, advance)
        out.update(zip(members, results, strict=True))
    return [out[i] for i in range(len(experiments))]


def _run_group(experiments: list[Experiment], threads: int, advance: Advance) -> list[RunResult]:
    models = _models(experiments)
    batch = Batch(models[0], len(experiments), threads)
    written = (
        Numbers._fields if any(rule.names != (MASS,) for e in experiments for rule in e.estimator.values()) else ()
    )
    for name in _different_fields(models) | {"body_mass", "body_inertia", *written}:
        batch.expand(name)[...] = [_field(model, name) for model in models]
    qpos, qvel, userdata = batch.bind("qpos"), batch.bind("qvel"), batch.bind("userdata")
    # masses and inertias always; the other two, of one model for all, are only written to where they are expanded
    live = [
        batch.expand(name)
        if name in ("body_mass", "body_inertia", *written)
        else [getattr(models[0], name)] * len(models)
        for name in Numbers._fields
    ]
    numbers = [Numbers(*one) for one in zip(*live, strict=True)]
    given = _given(experiments)
    reels = [tape_of(e, m).wind(u, c.pushes) for e, m, u, c in zip(experiments, models, userdata, given, strict=True)]
    records = [Record(e, handles_of(e, m), c) for e, m, c in zip(experiments, models, given, strict=True)]
    in_step = InStep(records, qpos, qvel, numbers) if InStep.serves(records) else None
    updates = [_side(one[0])(*one) for one in zip(records, qpos, qvel, numbers, strict=True)] if not in_step else []
    # after each tick all go on to the next; a run that is shorter stops at its own end
    stops = [[*t.ends.tolist(), e.steps] for t, e in zip(records, experiments, strict=True)]
    done, reasons = [0] * len(experiments), [""] * len(experiments)
    begin = time.perf_counter()
    for turn in range(max(len(s) for s in stops)):
        active = [i for i, s in enumerate(stops) if turn < len(s) and not reasons[i]]
        for count in sorted({stops[i][turn] - done[i] for i in active} - {0}):
            ids = [i for i in active if stops[i][turn] - done[i] == count]
            for i, reason in _step(batch, ids, count).items():
                reasons[i] = f"{reason} after {done[i] * experiments[i].scene.timestep_s:g} s"
            ids = [i for i in ids if not reasons[i]]
            for i in ids:
                done[i] += count
            ticking = [i for i in ids if turn < len(records[i].ends)]
            changed = in_step.update(turn, ticking) if in_step else [i for i in ticking if updates[i]()]
            if changed:
                batch.set_const(changed)
            advance(count * len(ids))
    wall_s = (time.perf_counter() - begin) / len(experiments)
    return [
        _result(records[i], truth_of(e, models[i]), reels[i].frames[: done[i]], wall_s, reasons[i])
        for i, e in enumerate(experiments)
    ]


def _models(experiments: list[Experiment]) -> list[mujoco.MjModel]:
    """Compile what differs in structure, copy what differs in numbers alone."""
    compiled: dict[str, tuple[mujoco.MjModel, mujoco.MjData]] = {}
    out = []
    for experiment in experiments:
        key = compile_key(experiment)
        if key not in compiled:
            root = scene_of(experiment)
            model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
            compiled[key] = model, mujoco.MjData(model)
        model, scratch = compiled[key]
        model = copy.copy(model)
        set_numbers(experiment, model, scratch)
        out.append(model)
    return out


def _given(experiments: list[Experiment]) -> list[Commands]:
    """Make the commands, once for all runs that are pushed alike."""
    made: dict[str, Commands] = {}
    out = []
    for e in experiments:
        key = repr((e.sequence, e.scene.timestep_s, e.steps, len(e.estimator), e.remote.effects))
        if key not in made:
            made[key] = commands(e)
        out.append(made[key])
    return out


def _field(model: mujoco.MjModel, name: str) -> Any:
    return getattr(model.opt, name[4:]) if name.startswith("opt.") else getattr(model, name)


def _different_fields(models: list[mujoco.MjModel]) -> set[str]:
    """Return the numbers, by the names that a batch knows them by, in which some models differ from the first."""
    out = set()
    distinct = list({id(m): m for m in models}.values())
    for name in MODEL_FIELDS:
        first = np.asarray(_field(distinct[0], name))
        if first.dtype.kind == "f" and any(not np.array_equal(first, _field(m, name)) for m in distinct[1:]):
            out.add(name)
    return out


def _step(batch: Batch, ids: list[int], count: int) -> dict[int, str]:
    """Step some simulations; return why, for those that blew up."""
    counters = batch.warning[:, :, 1]  # live; beside each counter stands MuJoCo's last message number
    before = counters.copy()
    failed: dict[int, str] = {}
    try:
        batch.step(ids if len(ids) < len(counters) else None, nstep=count)
    except SimulationError as error:
        failed = {int(i): batch.error(int(i)) for i in error.ids}
    grown = counters > before
    if grown.any():
        failed |= {i: warning_text(grown[i]) for i in ids if grown[i].any() and i not in failed}
    return failed


CONTACT = (
    ("friction_x_n", dry_friction.OUT_FORCE),
    ("friction_y_n", dry_friction.OUT_FORCE + 1),
    ("friction_torque_nm", dry_friction.OUT_TORQUE),
    ("pressure_x_m", dry_friction.OUT_COP),
    ("pressure_y_m", dry_friction.OUT_COP + 1),
    ("lifted_share", dry_friction.OUT_LIFTED),
    ("slip_m_s", dry_friction.OUT_SLIP),
    ("friction_w", dry_friction.OUT_POWER),
    ("load_n", dry_friction.OUT_LOAD),
)
POSITION = {
    dry_friction.PLANAR: ("x_m", "y_m", "yaw_rad"),
    dry_friction.UPRIGHT: ("x_m", "y_m", "z_m", "yaw_rad"),
    dry_friction.FREE: ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"),
}
VELOCITY = {
    dry_friction.PLANAR: ("vx_m_s", "vy_m_s", "wz_rad_s"),
    dry_friction.UPRIGHT: ("vx_m_s", "vy_m_s", "vz_m_s", "wz_rad_s"),
    dry_friction.FREE: ("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s"),
}


def _result(record: Record, truth: Mapping[str, Truth], frames: np.ndarray, wall_s: float, reason: str) -> RunResult:
    experiment, names = record.experiment, (REMOTE, *record.experiment.estimator)
    estimates = _estimates(record, truth)
    return RunResult(
        make_steps=lambda: Frames(_step_columns(record, names, frames, estimates)),
        make_updates=lambda: Frames(_update_columns(record, names, frames, estimates)),
        step_count=len(frames),
        update_count=record.count,
        estimators=tuple(experiment.estimator),
        parameters={name: {p: truth[p] for p in rule.names} for name, rule in experiment.estimator.items()},
        half_size_m=experiment.remote.half_size_m,
        timestep_s=experiment.scene.timestep_s,
        wall_s=wall_s,
        status=Status.diverged if reason else Status.done,
        reason=reason,
    )


def _read_only(columns: Iterable[tuple[str, np.ndarray]]) -> dict[str, np.ndarray]:
    out = {}
    for name, column in columns:
        column = np.ascontiguousarray(column)
        column.setflags(write=False)
        out[name] = column
    return out


def _state_columns(name: str, handle: Handle, qpos: np.ndarray, qvel: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of one body's state, from all positions (nq, n) and velocities (nv, n)."""
    q, v = qpos[handle.qpos_adr :], qvel[handle.dof_adr :]
    out = {f"{name}_{c}": q[i] for i, c in enumerate(POSITION[handle.joints])}
    if handle.joints == dry_friction.UPRIGHT:
        out[f"{name}_z_m"] = out[f"{name}_z_m"] + handle.rest_height_m
    out |= {f"{name}_{c}": v[i] for i, c in enumerate(VELOCITY[handle.joints])}
    if handle.joints == dry_friction.FREE:
        twist = handle.twist(qpos.T, qvel.T).T
        out |= {f"{name}_{c}": twist[i] for i, c in enumerate(VELOCITY[dry_friction.FREE])}
    return out


Estimates = list[tuple[str, float, np.ndarray]]  # name, value at the start, values after each update


def _estimates(record: Record, truth: Mapping[str, Truth]) -> Estimates:
    """Return estimates and their relative errors."""
    out = []
    for (name, rule), memories in zip(record.experiment.estimator.items(), record.memories, strict=True):
        table = np.array([rule.values(m) for m in memories]).reshape(len(memories), len(rule.names))
        for p, parameter in enumerate(rule.names):
            known = truth[parameter]
            out.append((f"{name}_{parameter}", known.start, table[:, p]))
            stem = parameter.rsplit("_", 1)[0]
            out.append((f"{name}_{stem}_error", known.error(known.start), known.error(table[:, p])))
    return out


def _details(record: Record) -> dict[str, np.ndarray]:
    """Return what estimators say besides their estimates, (m,) each."""
    out = {}
    for (name, rule), memories in zip(record.experiment.estimator.items(), record.memories, strict=True):
        if rule.details:
            table = np.array([rule.detail(m) for m in memories]).reshape(len(memories), len(rule.details))
            out |= {f"{name}_{detail}": table[:, i] for i, detail in enumerate(rule.details)}
    return out


def _step_columns(
    record: Record, names: Sequence[str], frames: np.ndarray, estimates: Estimates
) -> dict[str, np.ndarray]:
    n = len(frames)
    updates = np.zeros(n + 1, dtype=np.int64)
    updates[record.ends[record.ends <= n]] = 1
    updates = np.cumsum(updates)[:n]  # so many before this frame
    out: dict[str, np.ndarray] = {
        "time_s": np.arange(n) * record.experiment.scene.timestep_s,
        "frame": np.arange(n),
        "update": updates,
    }
    raw = np.ascontiguousarray(frames.T)  # (width, n): columns in one piece
    out |= _command_columns(record, slice(n))
    for name, handle in zip(names, record.handles, strict=True):
        out |= _state_columns(name, handle, raw[: record.nq], raw[record.nq :])
    out |= _contact_columns(record, names, raw)
    held = np.minimum(updates, record.count)
    out |= {name: np.concatenate([[start], column])[held] for name, start, column in estimates}
    return _read_only(out.items())


def _command_columns(record: Record, rows: slice | np.ndarray) -> dict[str, np.ndarray]:
    force, point = record.commands.force_n[rows], record.commands.point_m[rows]
    out = {f"force_{axis}_n": force[:, j] for j, axis in enumerate("xyz")}
    return out | {f"point_{axis}_m": point[:, j] for j, axis in enumerate("xyz")}


def _contact_columns(record: Record, names: Sequence[str], raw: np.ndarray) -> dict[str, np.ndarray]:
    """What the law said of each body, from raw frames (width, n); nothing where it does not carry the bodies."""
    out = {}
    for b, (name, handle) in enumerate(zip(names, record.handles, strict=True)):
        if handle.joints == dry_friction.PLANAR:
            base = record.nq + record.nv + b * dry_friction.OUT_SIZE
            out |= {f"{name}_{column}": raw[base + offset] for column, offset in CONTACT}
    return out


def _update_columns(
    record: Record, names: Sequence[str], frames: np.ndarray, estimates: Estimates
) -> dict[str, np.ndarray]:
    m = record.count
    qpos, qvel = np.ascontiguousarray(record.qpos[:m].T), np.ascontiguousarray(record.qvel[:m].T)
    times, message = record.ends[:m] * record.experiment.scene.timestep_s, record.message[:m]
    last = record.ends[:m] - 1  # the step that ends with the update
    out = {
        "time_s": times,
        "update": np.arange(1, m + 1),
        "frame": record.ends[:m],
        "sent_s": np.where(message >= 0, times[message], np.nan) if m else times,
    }
    out |= _command_columns(record, last)
    for name, handle in zip(names, record.handles, strict=True):
        out |= _state_columns(name, handle, qpos, qvel)
    out |= _contact_columns(record, names, np.ascontiguousarray(frames[last].T))
    for name, outcomes in zip(names[1:], record.outcomes, strict=True):
        out |= _behind(name, out)
        out[f"{name}_outcome"] = np.array(outcomes, dtype=np.int8)
    for (name, rule), shown in zip(record.experiment.estimator.items(), record.shown, strict=True):
        columns = np.array(shown).reshape(len(shown), len(rule.names))
        out |= {f"{name}_shown_{p}": columns[:, i] for i, p in enumerate(rule.names) if shown}
    out |= {name: column for name, _, column in estimates}
    out |= _details(record)
    return _read_only(out.items())


def _behind(name: str, columns: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """How far the local cube was from the remote, just before it took over what it received."""

    def size(names: Iterable[str]) -> np.ndarray:
        parts = [columns[f"{name}_{c}"] - columns[f"{REMOTE}_{c}"] for c in names if f"{name}_{c}" in columns]
        return np.sqrt(sum(p * p for p in parts))

    return {
        f"{name}_position_error_m": size(("x_m", "y_m", "z_m")),
        f"{name}_velocity_error_m_s": size(("vx_m_s", "vy_m_s", "vz_m_s")),
        f"{name}_rate_error_rad_s": size(("wx_rad_s", "wy_rad_s", "wz_rad_s")),
    }
