"""Time of a diagnosis, beside the bare simulation of the seconds that it simulates.

    python -m benchmarks.diagnose [DIR]

Recordings of 8 episodes of 6 s at 60 Hz are made from the planar core with an effect planted: hard pushes off the
centre, which make 0.2 % of friction a gap of several noises and 2 % one of forty. Or they are taken from DIR, a case or
a folder of cases. They are diagnosed with the whole vocabulary on all cores. The floor is what `mujoco.rollout` alone
needs for as many seconds of the nominal model, measured in the same process with the same threads.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from runner.diagnosis.pipeline import diagnose
from runner.effects.planar_box import ActuatorDelay, Friction, PlanarEffect
from runner.recording import Episode, Form, Nominal, Recording, find_cases, read_case
from runner.recording.data import Noise
from runner.systems.planar_box.simulator import Run, Simulator
from runner.systems.planar_box.system import PlanarBox

RATE_HZ, EPISODES, LENGTH_S = 60.0, 8, 6.0
NOISE = np.array([0.005, 0.005, 0.008, 0.02, 0.02, 0.03])


def recording(effects: tuple[PlanarEffect, ...], seed: int, folder: Path) -> Recording:
    """Return a recording of pushes at random points, with effects planted and noise on top."""
    draw = np.random.default_rng(seed)
    t = np.arange(round(LENGTH_S * RATE_HZ) + 1) / RATE_HZ
    zero = np.zeros((len(t), 3))
    episodes = []
    for e in range(EPISODES):
        force, point = zero.copy(), zero.copy()
        for begin in np.arange(0.3, LENGTH_S - 1.0, 1.2):
            held = (t >= begin) & (t < begin + draw.uniform(0.3, 0.8))
            angle, size = draw.uniform(0, 2 * np.pi), draw.uniform(11, 24)
            force[held, :2] = size * np.cos(angle), size * np.sin(angle)
            point[held, :2] = draw.uniform(-0.3, 0.3, 2)
        episodes.append(Episode(e, t, zero, zero, force, point))
    nominal = Nominal(
        half_size_m=(0.5, 0.5, 0.5), mass_kg=3.0, friction=0.3, gravity_m_s2=9.81, rate_hz=RATE_HZ, noise=Noise()
    )
    still = Recording(folder, Form.PLANAR, nominal, tuple(episodes))
    simulator = Simulator(still, step_rate_hz=480.0, grid=8)
    tables = []
    for i, episode in enumerate(episodes):
        motion = simulator.predict(i, [Run(effects, np.zeros(6))])[0] + NOISE * draw.standard_normal((len(t), 6))
        columns = {"episode": np.full(len(t), i), "t": t}
        columns |= dict(zip(("x", "y", "yaw", "vx", "vy", "wz"), motion.T, strict=True))
        columns |= {"fx": episode.force_n[:, 0], "fy": episode.force_n[:, 1]}
        columns |= {"px": episode.point_m[:, 0], "py": episode.point_m[:, 1]}
        tables.append(pd.DataFrame(columns))
    pd.concat(tables).to_parquet(folder / "recording.parquet", index=False)
    believed = {"half_size": 0.5, "mass": 3.0, "friction": 0.3, "gravity": 9.81, "rate_hz": RATE_HZ, "noise": None}
    (folder / "nominal.yaml").write_text(yaml.safe_dump(believed))
    return read_case(folder)


def bare_us_per_s(case: Recording) -> float:
    """Return the wall time of one simulated second of the nominal model, microseconds."""
    simulator = Simulator(case, grid=8)
    runs = [Run((), np.zeros(6))] * 16
    simulator.predict(0, runs)
    begun, before = time.perf_counter(), simulator.simulated_s
    for _ in range(3):
        for e in range(len(case.episodes)):
            simulator.predict(e, runs)
    return 1e6 * (time.perf_counter() - begun) / (simulator.simulated_s - before)


def main(folder: str | None = None) -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as made:
        if folder is None:
            planted = {
                "friction off by 0.2 %": (Friction(0.3007),),
                "friction off by 2 %": (Friction(0.306),),
                "friction and delay": (Friction(0.294), ActuatorDelay(0.01)),
                "nothing": (),
            }
            cases = {}
            for i, (name, effects) in enumerate(planted.items()):
                (place := Path(made) / str(i)).mkdir()
                cases[name] = recording(effects, i, place)
        else:
            cases = {path.name: read_case(path) for path in find_cases(folder)}
        print(f"{'case':24s}{'first answer':>30s}{'wall s':>9s}{'simulated s':>13s}{'bare s':>9s}{'ratio':>8s}")
        for name, case in cases.items():
            found = diagnose(PlanarBox(case))
            bare_s = 1e-6 * bare_us_per_s(case) * found.simulated_s
            first = "+".join(found.ranked[0].effects)
            print(
                f"{name:24s}{first:>30s}{found.wall_s:9.1f}{found.simulated_s:13.0f}{bare_s:9.1f}"
                f"{found.wall_s / bare_s:8.2f}"
            )


if __name__ == "__main__":
    main(*sys.argv[1:2])
