"""A fit of a push that lasts too long goes on from pushes of the same impulse."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from runner.inference.least_squares import Explanation, Fitter
from runner.inference.shortlist import finished
from runner.noise.measured import measure
from tests.mechanism_cases import PENDULUM, joint_channels, system_of, write_case

FORCE, FROM_S, UNTIL_S = 0.4, 1.59, 2.19
INERTIA, WEIGHT, DAMPING = 0.01 + 1.5 * 0.4**2, 1.5 * 9.81 * 0.4, 0.05
NOISE = {"q_hinge": 2e-3, "dq_hinge": 1e-2}


def pushed(start: float, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return a pendulum's motion under a random torque, pushed for 0.6 s."""
    t = np.arange(0.0, 5.5, 0.01)
    u = np.repeat(rng.uniform(-1.0, 1.0, size=11), 50)[: len(t)]

    def slope(at: float, x: np.ndarray) -> list[float]:
        torque = u[min(int(at / 0.01 + 1e-6), len(u) - 1)] + FORCE * (FROM_S <= at < UNTIL_S)
        return [x[1], (torque - WEIGHT * np.sin(x[0]) - DAMPING * x[1]) / INERTIA]

    found = solve_ivp(slope, (0.0, t[-1]), [start, 0.0], t_eval=t, max_step=0.005, rtol=1e-8, atol=1e-9)
    q, dq = (y + s * rng.normal(size=len(t)) for y, s in zip(found.y, NOISE.values(), strict=True))
    return {"t": t, "u": u, "q_hinge": q, "dq_hinge": dq}


def test_a_push_that_lasts_too_long_is_cut_to_what_it_was(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": joint_channels(["hinge"]),
        "noise": NOISE,
        "start": "free",
    }
    case = write_case(
        tmp_path / "case", PENDULUM.format(damping=DAMPING), [pushed(a, rng) for a in (0.2, -0.3)], nominal
    )
    system = system_of(case)
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    candidate = next(c for c in system.vocabulary if c.name == "disturbance[hinge]")
    episodes, count = (0, 1), fitter.measured.count((0, 1))
    stuck = fitter.fit(Explanation((candidate,)), episodes, x=np.array([0.2, FROM_S, 1.8]), iterations=30)
    assert stuck.total > 2.0 * count  # a descent alone rests in one that lasts a swing longer
    (fit,) = finished(fitter, [stuck], count, 1, steps=20)
    np.testing.assert_allclose(fit.x, [FORCE, FROM_S, UNTIL_S - FROM_S], rtol=0.03)
    assert fit.total == pytest.approx(count, rel=0.1)
