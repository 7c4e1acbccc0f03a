"""A number that a recording does not tell is stated as uncertain as it was before the recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from runner.diagnosis.ranking import values_of
from runner.effects.wording import Values
from runner.inference.contender import contend
from runner.inference.least_squares import Explanation, Fitter
from runner.noise.measured import measure
from tests.mechanism_cases import PENDULUM, joint_channels, system_of, write_case

LENGTH_M, MASS_KG, INERTIA, DAMPING = 0.4, 1.5, 0.01, 0.05
OFF_M = 0.02  # along the lever


def test_where_a_centre_of_mass_is_along_the_axis_is_not_told(tmp_path: Path) -> None:
    """A lever turns alike wherever its mass is along its axis: that number is 0, and its error that of the prior."""
    t, rng, columns = np.arange(301) * 0.01, np.random.default_rng(3), []
    for amplitude, hz in ((1.5, 0.6), (2.5, 0.9)):
        u, x, q = amplitude * np.sin(2 * np.pi * hz * t), np.zeros(2), []
        arm = LENGTH_M + OFF_M
        for k in range(len(t)):  # the command is held over each sample
            q.append(x[0])
            for _ in range(20):
                x[1] += (
                    5e-4 * (u[k] - DAMPING * x[1] - MASS_KG * 9.81 * arm * np.sin(x[0])) / (INERTIA + MASS_KG * arm**2)
                )
                x[0] += 5e-4 * x[1]
        columns.append({"t": t, "u": u, "q_hinge": np.array(q) + 1e-3 * rng.standard_normal(len(t))})
    channels = joint_channels(["hinge"], velocities=False)
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": channels,
        "noise": {"q_hinge": 1e-3},
        "start": "rest",
    }
    system = system_of(write_case(tmp_path / "case", PENDULUM.format(damping=DAMPING), columns, nominal))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    candidate = next(c for c in system.vocabulary if c.name == "com_offset[lever]")
    fit = fitter.fit(Explanation((candidate,)), (0, 1))
    values, errors = (by["com_offset[lever]"] for by in values_of(contend(fitter, fit), system.context))
    assert values["z_m"] == pytest.approx(-OFF_M, abs=1e-3)
    assert errors["z_m"] < 1e-3
    assert abs(values["y_m"]) < 1e-6
    prior = dict(zip("xyz", (p.scale for p in candidate.parameters(system.context)), strict=True))["y"]
    assert errors["y_m"] == pytest.approx(prior, rel=0.2)
    assert Values(values, errors).long("y_m").startswith("0 ± ")


def test_lengths_that_are_told_together_are_in_one_unit() -> None:
    """In that which suits the largest."""
    of = Values({"x_m": 0.02502, "y_m": -0.0101}, {"x_m": 0.00017, "y_m": 0.00017})
    assert of.longs("x_m", "y_m") == "(2.502 ± 0.017, −1.010 ± 0.017) cm"
    assert of.long("y_m") == "−10.10 ± 0.17 mm"


@pytest.mark.parametrize(
    ("error", "said"), [(0.02, "0.25 ± 0.02 m/s"), (30.0, "0.250 m/s (the data hardly tell at which)")]
)
def test_a_speed_at_which_a_law_bends_is_never_nought(error: float, said: str) -> None:
    """Rounded to the place of its error, a speed that the recording does not tell would be 0 ± 30 m/s."""
    assert Values({"speed_m_s": 0.25}, {"speed_m_s": error}).scale("speed_m_s", "m/s") == said
