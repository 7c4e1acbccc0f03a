"""A start state is fitted to longer and longer parts of an episode that was not fitted."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from runner.inference.contender import contend
from runner.inference.evidence import directions, sensitivities
from runner.inference.least_squares import NONE, Fitter
from runner.inference.unseen import _grown_start, _holding, unseen
from runner.noise.measured import measure
from runner.systems.windows import Windows
from tests.mechanism_cases import PENDULUM, joint_channels, slide_case, system_of, write_case

INERTIA, WEIGHT, DAMPING = 0.01 + 1.5 * 0.4**2, 1.5 * 9.81 * 0.4, 0.02
NOISE = {"q_hinge": 2e-3, "dq_hinge": 1e-2}
TRUE = 3.1, 0.0  # a hair from upright: which way it falls, and when, is all in the start


def fallen(rng: np.random.Generator, noise: Mapping[str, float] = NOISE) -> dict[str, np.ndarray]:
    """Return the motion of a pendulum that is let go nearly upright, in the channels that have a noise."""
    t = np.arange(0.0, 6.0, 0.01)

    def slope(_: float, x: np.ndarray) -> list[float]:
        return [x[1], (-WEIGHT * np.sin(x[0]) - DAMPING * x[1]) / INERTIA]

    found = solve_ivp(slope, (0.0, t[-1]), TRUE, t_eval=t, rtol=1e-10, atol=1e-11)
    shown = {name: y + s * rng.normal(size=len(t)) for y, (name, s) in zip(found.y, noise.items(), strict=False)}
    return {"t": t, "u": np.zeros_like(t), **shown}


def test_a_start_that_a_whole_episode_has_led_astray_is_found_by_its_parts(tmp_path: Path) -> None:
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": joint_channels(["hinge"]),
        "noise": NOISE,
        "start": "free",
    }
    rng = np.random.default_rng(3)
    case = write_case(tmp_path / "case", PENDULUM.format(damping=DAMPING), [fallen(rng), fallen(rng)], nominal)
    system = system_of(case)
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    count = fitter.measured.count([0])
    astray = np.array([[2.0, 0.0]])
    assert fitter.loss(NONE, np.empty(0), astray, [0]) > 100.0 * count
    grown = _grown_start(fitter, 0, astray[0])
    assert fitter.loss(NONE, np.empty(0), grown[None], [0]) == pytest.approx(count, rel=0.15)
    np.testing.assert_allclose(grown, TRUE, atol=0.01)
    # what is right stays as it is
    np.testing.assert_array_equal(_grown_start(fitter, 0, grown), grown)
    # here the first samples tell enough that a descent of the whole finds it, too, from where it refuses every step
    found = fitter.fit(NONE, [0], starts=astray, iterations=30)
    assert found.total == pytest.approx(count, rel=0.15)


def test_an_unseen_episode_is_not_held_against_an_explanation_for_its_start(tmp_path: Path) -> None:
    """Position alone tells the speed so roughly that a descent ends far from the motion, by a model that is right."""
    noise = {"q_hinge": 0.05}
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": {"q_hinge": {"joint": "hinge", "quantity": "position"}},
        "noise": noise,
        "start": "free",
    }
    rng = np.random.default_rng(0)
    motions = [fallen(rng, noise), fallen(rng, noise)]
    system = system_of(write_case(tmp_path / "case", PENDULUM.format(damping=DAMPING), motions, nominal))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    count = fitter.measured.count([0])
    fit = fitter.fit(NONE, [0], starts=np.array([TRUE]))
    right = contend(fitter, fit, sensitivities(fitter, fit, directions(system)))
    assert _holding(right, fitter).fit(NONE, [1]).total > 100.0 * count
    assert unseen(right, fitter, [1], None).total == pytest.approx(count, rel=0.15)


def test_what_begins_at_rest_has_no_speed_in_any_window_from_there(tmp_path: Path) -> None:
    """A slope of noisy samples is none; a window that begins later has the speed that it has."""
    rng = np.random.default_rng(0)

    def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return t**2 / 2 + 1e-3 * rng.normal(size=len(t)), t + 1e-2 * rng.normal(size=len(t))

    for start, at_rest in (("rest", True), ("free", False)):
        system = system_of(slide_case(tmp_path / start, motion=motion, start=start))
        windows = Windows(np.array([0, 0]), np.array([0, 200]), 20)
        for smooth in (True, False):
            rates = system.initial.guess_windows(measure(system), windows, smooth=smooth)[:, 1]
            assert (rates[0] == 0.0) == at_rest
            assert rates[1] == pytest.approx(1.0, abs=0.1)
