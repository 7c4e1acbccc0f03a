"""A body that tumbles about a centre of mass which is not where it is measured: against Euler's equations."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from test_tossed import SIDES, G, still

from runner.effects import mechanism as m
from runner.systems.mechanism import MechanismSystem
from runner.systems.simulator import Run

SPIN = np.array([6.0, 0.3, 8.0])
OFF = np.array([0.008, -0.006, 0.004])


def errors(system: MechanismSystem, step_s: float) -> tuple[float, float]:
    """Return how far off place, m, and orientation, rad, are in such steps, the most of all times."""
    recording = system.recording
    t = recording.episodes[0].t_s
    x, y, z = np.array(SIDES) ** 2
    inertia = np.array([y + z, x + z, x + y])

    def change(_: float, state: np.ndarray) -> np.ndarray:
        w, (i, j, k, r) = state[:3], state[3:]
        turning = 0.5 * (r * w + np.cross([i, j, k], w))
        return np.concatenate([np.cross(inertia * w, w) / inertia, turning, [-0.5 * np.dot([i, j, k], w)]])

    run = solve_ivp(change, (0, t[-1]), [*SPIN, 0, 0, 0, 1], t_eval=t, rtol=1e-11, atol=1e-13)
    turned = Rotation.from_quat(run.y[3:].T)
    # the centre of mass flies along a parabola, what is measured goes round it
    fall = np.outer(-0.5 * G * t**2, [0, 0, 1])
    place = OFF + np.outer(t, np.cross(SPIN, OFF)) + fall - turned.apply(OFF)
    start = np.concatenate([[0, 0, 2.0, 0, 0, 0], [0, 0, 0], SPIN])
    stepped = MechanismSystem(recording, step_s=step_s).simulator()
    shown = stepped.predict(0, [Run((m.ComOffset("box", *OFF),), start)])[0]
    away = shown[:, :3] - shown[0, :3] - place
    off = (turned.inv() * Rotation.from_rotvec(shown[:, 3:6])).as_rotvec()
    return float(np.abs(away).max()), float(np.abs(off).max())


def test_steps_are_of_second_order(tmp_path: Path) -> None:
    """Of steps half as long a quarter of the error, of a body that may hit a floor."""
    system = still(tmp_path, half_size=list(SIDES))
    coarse, fine = (errors(system, 1 / 150 / n) for n in (3, 6))
    assert fine[0] < 2e-5
    assert fine[1] < 3e-4
    assert coarse[0] / fine[0] == pytest.approx(4.0, rel=0.2)
    assert coarse[1] / fine[1] == pytest.approx(4.0, rel=0.2)
