"""The exponent by which a joint's dry friction falls with speed: what a motion tells of it, and where it tells none."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from runner.diagnosis.ranking import values_of
from runner.inference.contender import contend
from runner.inference.least_squares import Explanation, Fitter
from runner.noise.measured import measure
from tests.mechanism_cases import MOTOR, SLIDE, joint_channels, system_of, write_case

MASS_KG, DRY_N, DAMPING, STEP_S = 2.0, 3.0, 6.0, 0.01
SPEED_M_S, EXPONENT, NOISE_M = 0.15, 1.0, 3e-4


def moved(push_n: np.ndarray, excess: float) -> np.ndarray:
    """Return where a carriage is at each sample that slides from the start and is pushed on, (n,), by its equation."""

    def change(_: float, y: np.ndarray, push: float) -> list[float]:
        dry = DRY_N * (1.0 + excess * math.exp(-((y[1] / SPEED_M_S) ** EXPONENT)))
        return [y[1], (push - dry - DAMPING * y[1]) / MASS_KG]

    states = [np.array([0.0, 0.05])]
    for push in push_n[:-1]:
        states.append(solve_ivp(change, (0.0, STEP_S), states[-1], args=(push,), rtol=1e-8, atol=1e-10).y[:, -1])
    q, v = np.array(states).T
    assert v.min() > 0.0
    return q


def fitted(folder: Path, excess: float) -> tuple[Mapping[str, float], Mapping[str, float]]:
    """Return values and standard errors of the effect, fitted to two episodes between slow and fast."""
    rng, t, columns = np.random.default_rng(0), np.arange(251) * STEP_S, []
    for mean, amplitude in ((7.0, 1.5), (6.0, 0.8)):
        u = mean + amplitude * np.sin(2 * np.pi * (0.3 + 0.3 * t) * t)
        columns.append({"t": t, "u": u, "q_slide": moved(u, excess) + NOISE_M * rng.standard_normal(len(t))})
    model = SLIDE.format(friction=DRY_N, damping=DAMPING, mass=MASS_KG, actuator=MOTOR)
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": joint_channels(["slide"], velocities=False),
        "noise": {"q_slide": NOISE_M},
        "start": "free",
    }
    system = system_of(write_case(folder, model, columns, nominal))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    (candidate,) = system.vocabulary.by_name["stribeck[slide]"]
    fit = fitter.fit(Explanation((candidate,)), (0, 1), x=candidate.starts(system.context)[-1], iterations=40)
    values, errors = values_of(contend(fitter, fit), system.context)
    return values["stribeck[slide]"], errors["stribeck[slide]"]


def test_an_exponent_is_found_from_the_motion(tmp_path: Path) -> None:
    """Tustin's law, begun at an exponent of 2: three numbers within their errors, and that of the exponent is small."""
    values, errors = fitted(tmp_path / "case", 0.6)
    assert errors["exponent"] < 0.1
    for name, true in ("exponent", EXPONENT), ("relative_excess", 0.6), ("speed", SPEED_M_S):
        assert abs(values[name] - true) < 3 * errors[name], name


def test_an_exponent_of_no_excess_is_as_uncertain_as_before(tmp_path: Path) -> None:
    """Where friction does not fall nothing tells how: the error of the exponent is no less than what its prior says."""
    values, errors = fitted(tmp_path / "case", 0.0)
    assert abs(values["relative_excess"]) < 3 * errors["relative_excess"]
    assert errors["exponent"] > 0.45 * values["exponent"]
