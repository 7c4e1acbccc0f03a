"""What acts in second order is no finding where the recording may as well be without it."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from runner.diagnosis.ranking import rank, values_of
from runner.effects.mechanism.gravity import Gravity
from runner.effects.vocabulary import Vocabulary
from runner.effects.wording import Values
from runner.inference.contender import contend
from runner.inference.least_squares import Explanation, Fitter
from runner.inference.search import search
from runner.inference.untold import without_untold
from runner.noise.measured import measure
from tests.mechanism_cases import PENDULUM, joint_channels, system_of, write_case

TILT_RAD, DAMPING, STEP_S = 0.05, 0.05, 0.01


@cache
def episodes(weight: float) -> list[dict[str, np.ndarray]]:
    """Return what a lever does whose base leans by `TILT_RAD` towards x, with so many times the weight."""
    t, columns = np.arange(301) * STEP_S, []
    for amplitude, hz in ((1.5, 0.6), (2.5, 0.9)):
        u, states = amplitude * np.sin(2 * np.pi * hz * t), [np.zeros(2)]
        for torque in u[:-1]:

            def change(_: float, y: np.ndarray, torque: float = torque) -> list[float]:
                force = torque - DAMPING * y[1] - weight * 1.5 * 9.81 * 0.4 * np.sin(y[0] - TILT_RAD)
                return [y[1], force / (0.01 + 1.5 * 0.4**2)]

            states.append(solve_ivp(change, (0.0, STEP_S), states[-1], rtol=1e-8, atol=1e-10).y[:, -1])
        columns.append({"t": t, "u": u, "q_hinge": np.array(states)[:, 0]})
    return columns


def swung(weight: float, noise_rad: float, folder: Path, effect: str = "gravity") -> Fitter:
    """Return a fitter of those episodes to which one effect is known.

    Args:
        weight: Times that of the lever, as if the base leaned towards y, too.
        noise_rad: As it is stated; there is none, so that what is found is no accident.
        folder: To write to.
        effect: Which; a gravity that points elsewhere, not one of another size.
    """
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": joint_channels(["hinge"], velocities=False),
        "noise": {"q_hinge": noise_rad},
        "start": "rest",
    }
    system = system_of(write_case(folder, PENDULUM.format(damping=DAMPING), episodes(weight), nominal))
    system.vocabulary = Vocabulary(tuple(c for c in system.vocabulary if c.name == effect and c.effect is not Gravity))
    return Fitter(system, system.simulator(threads=1), measure(system))


def test_a_tilt_about_an_axis_that_nothing_turns_along_is_not_told(tmp_path: Path) -> None:
    """Gravity 0.15 per mille weaker is a lean of 1 degree of either sign: its errors tell it, what is left does not."""
    fitter = swung(float(np.cos(0.0175)), 4e-3, tmp_path)
    (tilt,) = fitter.system.vocabulary
    local = contend(fitter, fitter.fit(Explanation((tilt,)), (0, 1), x=np.array([TILT_RAD, 0.02])))
    values, errors = (by["gravity"] for by in values_of(local, fitter.context))
    assert abs(values["tilt_y_rad"]) > 3 * errors["tilt_y_rad"]
    first = rank(search(fitter, (0, 1), most=1), fitter.system, 0.03, ())[0]
    values, errors = first.parameters["gravity"], first.errors["gravity"]
    assert values["tilt_y_rad"] == 0.0
    assert errors["tilt_y_rad"] == pytest.approx(tilt.parameters(fitter.context)[1].scale, rel=0.2)
    assert values["tilt_x_rad"] == pytest.approx(TILT_RAD, abs=3 * errors["tilt_x_rad"])
    assert errors["tilt_x_rad"] < 3e-4
    assert [e.report() for e in first.values] == [values]  # what is put into the corrected model
    amount = tilt.effect.phrase(Values(values, errors), fitter.system.beliefs).amount
    assert amount.endswith(" and 0 ± 1.8° towards y")


def test_a_tilt_that_shows_by_its_square_is_told(tmp_path: Path) -> None:
    """Four standard errors of the weight are four of what is left without the tilt: it stays."""
    fitter = swung(float(np.cos(0.03)), 4e-3, tmp_path)
    first = rank(search(fitter, (0, 1), most=1), fitter.system, 0.03, ())[0]
    assert abs(first.parameters["gravity"]["tilt_y_rad"]) == pytest.approx(0.03, abs=2e-3)


def test_what_acts_in_proportion_stays(tmp_path: Path) -> None:
    """Where a mass is across a lever acts as a lean does: at 1.5 standard errors it is little told, and is kept."""
    fitter = swung(1.0, 1.1, tmp_path, "com_offset[lever]")
    (offset,) = fitter.system.vocabulary
    kept = contend(fitter, fitter.fit(Explanation((offset,)), (0, 1)))
    values, errors = (by["com_offset[lever]"] for by in values_of(kept, fitter.context))
    assert 1.0 < abs(values["x_m"]) / errors["x_m"] < 2.0
    assert values["z_m"] != 0.0
    assert without_untold(kept, fitter) is None


def test_the_last_number_of_an_effect_is_left_to_the_evidence(tmp_path: Path) -> None:
    """Of two numbers that tell nothing one may go, and not the effect with them."""
    fitter = swung(1.0, 4e-3, tmp_path)
    (tilt,) = fitter.system.vocabulary
    told = contend(fitter, fitter.fit(Explanation((tilt,)), (0, 1), x=np.array([TILT_RAD, 0.0])))
    assert without_untold(told, fitter) is None
