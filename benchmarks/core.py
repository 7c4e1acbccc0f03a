"""CPU time of a whole 20 s run in the closed loop, as a ratio to a bare replay of the same steps.

    python -m benchmarks.core [rounds]

The bare replay is `mujoco.rollout` of the same scene (without a player) under the same commands, one call, one thread.
Both start from a compiled model. The closed loop makes its commands, steps, estimates, changes the mass, takes over the
remote's state, and keeps the raw numbers of every physics step and every update; with logging it also writes
`summary.parquet`, `frames.parquet` and a full `run.rrd`, and last every physics step as well. The kinds of run take
turns, so that a busy machine slows all of them; the figure is the median of the ratios within each round.
"""

from __future__ import annotations

import dataclasses
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
from mujoco import rollout

from runner.physics import dry_friction
from runner.physics.forces import PaperForces
from runner.physics.scene import SceneConfig, build
from runner.teleop import loop
from runner.teleop.estimators import Linear
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig, commands, compile_experiment
from runner.teleop.link import LinkConfig
from runner.teleop.sinks import FrameKind, LogConfig, RrdDetail
from runner.teleop.tables import summary_row, write_summary

EXPERIMENT = Experiment(
    seed=0,
    scene=SceneConfig(),
    forces=PaperForces(rest_s=1.45),  # ends after 20 s
    remote=RemoteConfig(),
    start=StartConfig(),
    link=LinkConfig(),
    estimator={"linear": Linear()},
)
USERDATA = mujoco.mjtState.mjSTATE_USERDATA.value
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS.value


def replay() -> Callable[[], None]:
    """Return a function that replays the run's steps without a loop around them."""
    root = build(EXPERIMENT.scene, {"remote": EXPERIMENT.remote.body, "local": EXPERIMENT.remote.body})
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    data = mujoco.MjData(model)
    start = np.empty((1, mujoco.mj_stateSize(model, FULL)))
    mujoco.mj_getState(model, data, start[0], FULL)
    pushes = commands(EXPERIMENT).pushes[:-1].reshape(-1, 2, dry_friction.PUSH_SIZE)
    control = np.zeros((1, len(pushes), model.nuserdata))
    for body in range(2):
        at = body * dry_friction.USERDATA_SIZE
        control[0, :, at : at + dry_friction.PUSH_SIZE] = pushes[:, body]
    return lambda: rollout.rollout(model, data, start, control, control_spec=USERDATA) and None


def closed(log: LogConfig, folder: Path) -> Callable[[], None]:
    """Return a function that does the run and writes what `log` asks for."""
    config = dataclasses.asdict(EXPERIMENT)

    def once() -> None:
        result = loop.run_compiled(EXPERIMENT, compiled)
        for sink in log.sinks():
            sink.write(result, folder, config)
        if log.frames is not FrameKind.off:
            write_summary([summary_row(result)], folder)

    compiled = compile_experiment(EXPERIMENT)
    return once


def cpu_ms(work: Callable[[], None]) -> float:
    """Return the CPU time of a call, all threads, ms."""
    begin = time.process_time()
    work()
    return 1e3 * (time.process_time() - begin)


def main(repeats: int = 15) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        kinds = {
            "bare replay (mujoco.rollout)": replay(),
            "closed loop, logging off": closed(LogConfig(rrd=RrdDetail.off, frames=FrameKind.off), Path(folder)),
            "closed loop, Parquet alone": closed(LogConfig(rrd=RrdDetail.off), Path(folder)),
            "closed loop, logging full": closed(LogConfig(), Path(folder)),
            "closed loop, every physics step": closed(LogConfig(frames=FrameKind.steps), Path(folder)),
        }
        for work in kinds.values():
            work()
        times = np.array([[cpu_ms(work) for work in kinds.values()] for _ in range(repeats)])
    ratios = times / times[:, :1]
    print(f"{EXPERIMENT.steps} steps, two cubes, {repeats} rounds")
    print(f"{'':40s}{'CPU ms, median':>16s}{'ratio, median':>16s}{'quartiles':>16s}")
    for i, name in enumerate(kinds):
        low, high = np.quantile(ratios[:, i], [0.25, 0.75])
        print(f"{name:40s}{np.median(times[:, i]):16.1f}{np.median(ratios[:, i]):16.3f}{low:9.3f}-{high:.3f}")


if __name__ == "__main__":
    main(*(int(a) for a in sys.argv[1:2]))
