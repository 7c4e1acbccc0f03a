"""One effect is found where two have taken its place."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from runner.effects.planar_box import Friction, Stribeck
from runner.effects.planar_box.stribeck import StribeckFromRest
from runner.inference.contender import Contender, contend
from runner.inference.evidence import directions, sensitivities
from runner.inference.exchange import one_for_another, one_for_two, other_variants
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.inference.warm_start import key_of
from runner.noise.measured import measure
from runner.systems.planar_box.system import PlanarBox
from tests.cases import made
from tests.mechanism_cases import MOTOR, SLIDE, joint_channels, system_of, write_case

MASS_KG, BELIEVED_KG, DAMPING = 2.0, 1.4, 3.0
NOISE = {"q_slide": 1e-4, "dq_slide": 1e-3}


def driven(
    rng: np.random.Generator, tone_hz: float, damping: float = DAMPING, stiffness: float = 0.0
) -> dict[str, np.ndarray]:
    """Return the motion of a driven mass, m dv/dt = u - d v - k q with u a sine, commands held for a sample."""
    t = np.arange(0.0, 2.0, 0.005)
    u = 6.0 * np.sin(2 * np.pi * tone_hz * t)

    def slope(now: float, state: np.ndarray) -> list[float]:
        force = u[min(int(now / 0.005 + 1e-9), len(u) - 1)]
        return [state[1], (force - damping * state[1] - stiffness * state[0]) / MASS_KG]

    found = solve_ivp(slope, (0.0, t[-1]), (0.0, 0.0), t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.005)
    q, dq = (y + s * rng.normal(size=len(t)) for y, s in zip(found.y, NOISE.values(), strict=True))
    return {"t": t, "u": u, "q_slide": q, "dq_slide": dq}


def test_a_mass_is_found_behind_a_gain_and_a_damping(tmp_path: Path) -> None:
    """Believed to be 0.7 times as heavy, a mass moves as one would whose drive and damper have 0.7 times the force."""
    model = SLIDE.format(damping=DAMPING, friction=0, mass=BELIEVED_KG, actuator=MOTOR)
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["slide"]), "noise": NOISE}
    rng = np.random.default_rng(0)
    case = write_case(tmp_path / "case", model, [driven(rng, 0.5), driven(rng, 1.1)], nominal)
    system = system_of(case)
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    by_key = {c.name: c for c in system.vocabulary}
    two = Explanation((by_key["actuator_gain[drive]"], by_key["joint_damping[slide]"]))
    start = fitter.fit(NONE, [0, 1])
    fit = fitter.fit(two, [0, 1], near=start, iterations=20)
    whole = contend(fitter, fit, sensitivities(fitter, fit, directions(system)))
    count = fitter.measured.count([0, 1])
    assert fit.total == pytest.approx(count, rel=0.1)
    mass = Explanation((by_key["mass[carriage]"],))
    found = {key_of(f.explanation): f for f in one_for_two(fitter, whole, set())}
    assert found[key_of(mass)].total < fit.total + 10.0  # one number less
    assert BELIEVED_KG * np.exp(found[key_of(mass)].x[0]) == pytest.approx(MASS_KG, rel=2e-3)
    # what has been fitted is not fitted again
    assert key_of(mass) not in {key_of(f.explanation) for f in one_for_two(fitter, whole, {key_of(mass)})}


def test_a_spring_that_makes_up_for_another_effect_goes_with_it(tmp_path: Path) -> None:
    """Believed too heavy, a mass on a spring moves as one would whose drive and spring have more force."""
    believed_kg, stiffness = MASS_KG / 0.7, 40.0
    model = SLIDE.format(damping=0, friction=0, mass=believed_kg, actuator=MOTOR)
    model = model.replace('name="slide"', f'name="slide" stiffness="{stiffness}"', 1)
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["slide"]), "noise": NOISE}
    rng = np.random.default_rng(0)
    logs = [driven(rng, tone_hz, 0.0, stiffness) for tone_hz in (0.5, 1.1)]
    system = system_of(write_case(tmp_path / "case", model, logs, nominal))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    by_key = {c.name: c for c in system.vocabulary}
    spring, mass = by_key["joint_stiffness[slide]"], Explanation((by_key["mass[carriage]"],))
    assert spring.is_placed(fitter.context)
    fit = fitter.fit(Explanation((by_key["actuator_gain[drive]"], spring)), [0, 1], iterations=40)
    assert fit.total == pytest.approx(fitter.measured.count([0, 1]), rel=0.1)
    whole = contend(fitter, fit, sensitivities(fitter, fit, directions(system)))
    found = {key_of(f.explanation): f for f in one_for_two(fitter, whole, set())}
    assert believed_kg * np.exp(found[key_of(mass)].x[0]) == pytest.approx(MASS_KG, rel=2e-3)


def test_a_cause_is_found_from_the_motion_that_another_effect_has_found(tmp_path: Path) -> None:
    """A mass whose own descent had ended far off, from what a gain made of the motion; what is near is left alone."""
    model = SLIDE.format(damping=DAMPING, friction=0, mass=BELIEVED_KG, actuator=MOTOR)
    nominal = {"commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["slide"]), "noise": NOISE}
    rng = np.random.default_rng(0)
    system = system_of(write_case(tmp_path / "case", model, [driven(rng, 0.5), driven(rng, 1.1)], nominal))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    by_key = {c.name: c for c in system.vocabulary}
    gain, mass = (Explanation((by_key[name],)) for name in ("actuator_gain[drive]", "mass[carriage]"))
    fit = fitter.fit(gain, [0, 1], near=fitter.fit(NONE, [0, 1]), iterations=20)
    whole = contend(fitter, fit, sensitivities(fitter, fit, directions(system)))
    found = {key_of(f.explanation): f for f in one_for_another(fitter, whole, {key_of(mass): 1e9})}
    assert key_of(gain) not in found
    assert found[key_of(mass)].total == pytest.approx(fitter.measured.count([0, 1]), rel=0.1)
    assert fit.total > 2.0 * found[key_of(mass)].total
    near = {key_of(mass): fit.total + 1.0}
    assert key_of(mass) not in {key_of(f.explanation) for f in one_for_another(fitter, whole, near)}


def test_friction_that_is_right_at_rest_is_found_behind_less_of_it_that_rises_towards_rest() -> None:
    """One variant of an effect that has a place, in the stead of the other and a friction."""
    recording, _ = made((StribeckFromRest(-0.3, 0.3, 1.0),), episodes=3, seconds=3.0)
    system = PlanarBox(recording)
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    by_effect = {c.effect: c for c in system.vocabulary}
    two = Explanation((by_effect[Friction], by_effect[Stribeck]))
    start = fitter.fit(NONE, range(3))
    fit = fitter.fit(two, range(3), x=np.array([0.1, -0.2, np.log(1.5), 0.0]), near=start, iterations=20)
    whole = cast("Contender", SimpleNamespace(fit=fit))
    (found,) = other_variants(fitter, whole, set())
    assert found.explanation.candidates == (by_effect[StribeckFromRest],)
    assert found.total < fit.total + 10.0  # one number less
    assert found.total < start.total - 100.0
    assert other_variants(fitter, whole, {key_of(found.explanation)}) == []
