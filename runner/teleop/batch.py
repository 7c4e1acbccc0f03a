"""Many closed loops at once, on `mujoco.batch.Batch`; each gives the same bits as `runner.teleop.loop` does."""

from __future__ import annotations

import copy
import time
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import MODEL_FIELDS, Batch, SimulationError

from runner.progress import Advance, silent
from runner.teleop.columns import result_of
from runner.teleop.experiment import (
    Commands,
    Experiment,
    commands,
    compile_key,
    handles_of,
    player_of,
    scene_of,
    set_numbers,
    truth_of,
    warning_text,
)
from runner.teleop.frames import RunResult
from runner.teleop.parameters import MASS, ModelArrays
from runner.teleop.run_record import RunRecord
from runner.teleop.sides import LocalSides, side_of


def run_batch(experiments: Sequence[Experiment], *, threads: int = 0, advance: Advance = silent) -> list[RunResult]:
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
        ModelArrays._fields if any(rule.names != (MASS,) for e in experiments for rule in e.estimator.values()) else ()
    )
    for name in _different_fields(models) | {"body_mass", "body_inertia", *written}:
        batch.expand(name)[...] = [_field(model, name) for model in models]
    qpos, qvel, userdata = batch.bind("qpos"), batch.bind("qvel"), batch.bind("userdata")
    # masses and inertias always; the other two, of one model for all, are only written to where they are expanded
    live = [
        batch.expand(name)
        if name in ("body_mass", "body_inertia", *written)
        else [getattr(models[0], name)] * len(models)
        for name in ModelArrays._fields
    ]
    numbers = [ModelArrays(*one) for one in zip(*live, strict=True)]
    given = _given(experiments)
    playbacks = [
        player_of(e, m).start(u, c.pushes) for e, m, u, c in zip(experiments, models, userdata, given, strict=True)
    ]
    records = [RunRecord(e, handles_of(e, m), c) for e, m, c in zip(experiments, models, given, strict=True)]
    in_step = LocalSides(records, qpos, qvel, numbers) if LocalSides.serves(records) else None
    updates = [side_of(one[0])(*one) for one in zip(records, qpos, qvel, numbers, strict=True)] if not in_step else []
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
        result_of(records[i], truth_of(e, models[i]), playbacks[i].frames[: done[i]], wall_s, reasons[i])
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
