"""The closed loop: step both cubes, take in what the link delivers, estimate, take over the remote's state, record.

`run` does one experiment on dm-control's physics; `runner.teleop.batch` does many at once, with the same bits. Nothing
that looks at a run (logs, figures, tables) takes part in it: the loop keeps raw numbers (`RunRecord`), and makes frames
of them when it is over (`runner.teleop.columns`).
"""

from __future__ import annotations

import time

import mujoco
from dm_control.rl.control import PhysicsError

from runner.progress import Advance, silent
from runner.teleop.columns import result_of
from runner.teleop.experiment import CompiledExperiment, Experiment, commands, compile_experiment, set_start
from runner.teleop.frames import RunResult
from runner.teleop.parameters import ModelArrays
from runner.teleop.run_record import RunRecord
from runner.teleop.sides import side_of


def run(experiment: Experiment, advance: Advance = silent) -> RunResult:
    """Run one experiment on dm-control's physics.

    Args:
        experiment: What to run.
        advance: Called with the number of steps since its last call, now and then, for a progress bar.
    """
    return run_compiled(experiment, compile_experiment(experiment), advance)


def run_compiled(experiment: Experiment, compiled: CompiledExperiment, advance: Advance = silent) -> RunResult:
    """Run an experiment on a world that was built for it; the world starts afresh, whatever was done with it."""
    compiled.physics.reset()
    set_start(experiment, compiled.model, compiled.scratch)
    given = commands(experiment)
    model, data = compiled.model, compiled.data
    record = RunRecord(experiment, compiled.handles, given)
    update = side_of(record)(record, data.qpos, data.qvel, ModelArrays.of(model))
    playback = compiled.player.start(data.userdata, given.pushes)
    done, reason = 0, ""
    step, set_const, scratch = compiled.physics.step, mujoco.mj_setConst, compiled.scratch
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
        playback.stop()
    wall_s = time.perf_counter() - begin
    return result_of(record, compiled.truth, playback.frames[:done], wall_s, reason)
