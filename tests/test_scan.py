"""Where fits begin: sizes that are looked at all along, what an actuator was asked for, starts that are stuck."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from runner.effects.mechanism import Compliance
from runner.inference.contender import contend
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.inference.start_draws import begun_elsewhere
from runner.inference.unseen import unstuck
from runner.inference.warm_start import _raced, where_to_begin
from runner.noise.measured import measure
from runner.settings import SETTINGS
from runner.systems.mechanism import MechanismSystem
from tests.mechanism_cases import joint_channels, slide_case, system_of, write_case
from tests.mechanisms import FREE_SLIDER

LINK_KG, DRIVE_KG, STIFFNESS = 1.6, 0.4, 5000.0
DAMPING = 2.0 * 0.05 * np.sqrt(STIFFNESS * LINK_KG * DRIVE_KG / (LINK_KG + DRIVE_KG))
NOISE = {"q_slide": 2e-5, "dq_slide": 1e-3}


def test_what_a_servo_is_asked_for_is_what_its_target_jumps_by(tmp_path: Path) -> None:
    """At a standstill: stiffness times the jump, beyond the limit that it has."""
    servo = '<position name="drive" joint="slide" kp="600" kv="30" forcerange="-50 50"/>'
    case = slide_case(tmp_path / "case", actuator=servo, command=lambda t: np.where(t < 0.5, 0.0, 0.2))
    assert system_of(case).context.demand == pytest.approx({"drive": 120.0}, rel=1e-3)


def rung(rng: np.random.Generator, period_s: float) -> dict[str, np.ndarray]:
    """Return what a link does whose drive is pushed to and fro, by written-out equations of two masses and a spring."""
    t = np.arange(0.0, 1.5, 0.005)
    u = 5.0 * np.sign(np.sin(2.0 * np.pi * t / period_s))

    def slope(now: float, x: np.ndarray) -> list[float]:
        pull = STIFFNESS * (x[2] - x[0]) + DAMPING * (x[3] - x[1])
        push = u[min(int(now / 0.005 + 1e-9), len(u) - 1)]
        return [x[1], pull / LINK_KG, x[3], (push - pull) / DRIVE_KG]

    found = solve_ivp(slope, (0.0, t[-1]), np.zeros(4), t_eval=t, rtol=1e-8, atol=1e-10, max_step=0.0025)
    q, dq = (y + s * rng.normal(size=len(t)) for y, s in zip(found.y[:2], NOISE.values(), strict=True))
    return {"t": t, "u": u, "q_slide": q, "dq_slide": dq}


@pytest.fixture(scope="module")
def elastic(tmp_path_factory: pytest.TempPathFactory) -> MechanismSystem:
    rng = np.random.default_rng(0)
    nominal = {"commands": {"u": {"actuator": "slide"}}, "channels": joint_channels(["slide"]), "noise": NOISE}
    folder = tmp_path_factory.mktemp("elastic") / "case"
    return system_of(write_case(folder, FREE_SLIDER, [rung(rng, p) for p in (0.3, 0.43)], nominal | {"start": "free"}))


def test_a_fit_of_elasticity_begins_in_the_valley_of_its_resonance(elastic: MechanismSystem) -> None:
    """From half the stiffness a descent ends elsewhere; what is looked at lies as close as the valley is wide."""
    fitter = Fitter(elastic, elastic.simulator(threads=1), measure(elastic))
    nominal = fitter.fit(NONE, range(2))
    candidate = elastic.vocabulary.by_name["compliance[slide]"][0]
    gives = candidate.scan(fitter.context)
    assert (np.diff(gives) > 0).all()
    assert (gives[1:] / gives[:-1] < 1.0 + 0.05 * 5).all()  # half of that in frequency, twice the damping ratio
    fastest = np.sqrt(1.0 / gives[0] / (LINK_KG * DRIVE_KG / (LINK_KG + DRIVE_KG)))
    assert fastest == pytest.approx(np.pi / 0.005, rel=0.1)
    explanation, far = Explanation((candidate,)), np.array([2.0 / STIFFNESS])
    assert fitter.fit(explanation, range(2), x=far, near=nominal).total > 10.0 * fitter.measured.count(range(2))
    begin = where_to_begin(fitter, explanation, far, nominal, None)
    assert begin["x"][0] * STIFFNESS == pytest.approx(1.0, abs=0.2)
    fit = fitter.fit(explanation, range(2), **begin)
    assert fit.total < 1.2 * fitter.measured.count(range(2))
    (found,) = fit.explanation.make(fit.x, fitter.context)
    assert isinstance(found, Compliance)
    assert found.stiffness == pytest.approx(STIFFNESS, rel=0.005)


def test_sizes_that_are_far_behind_are_not_looked_at_in_further_episodes(elastic: MechanismSystem) -> None:
    """Those that stay have the loss of all episodes; where none gains, none between them is looked at either."""
    fitter = Fitter(elastic, elastic.simulator(threads=1), measure(elastic))
    right = Explanation(elastic.vocabulary.by_name["compliance[slide]"])
    best = fitter.fit(right, range(2), x=np.array([1.0 / STIFFNESS]))
    models = [right.make(best.x * by, fitter.context) for by in (1.0, 1.0 + 1e-6, 30.0)]
    all_of_them = fitter.losses(models, best.starts, range(2))
    raced = _raced(fitter, models, best)
    np.testing.assert_allclose(raced[:2], all_of_them[:2], rtol=1e-12)
    assert np.isinf(raced[2])
    assert np.isfinite(all_of_them[2])
    sizes, before = right.candidates[-1].scan(fitter.context), fitter.simulator.simulated_s
    begin = where_to_begin(fitter, right, best.x, best, None)
    np.testing.assert_array_equal(begin["x"], best.x)
    episodes = (fitter.simulator.simulated_s - before) / sum(fitter.seconds(e) for e in range(2))
    assert episodes < len(sizes)


def test_a_start_that_is_stuck_is_sought_anew_where_another_explanation_leaves_less(elastic: MechanismSystem) -> None:
    """What another explanation leaves less of by two log units is fitted from the first samples; the rest stays."""
    fitter = Fitter(elastic, elastic.simulator(threads=1), measure(elastic))
    right = Explanation(elastic.vocabulary.by_name["compliance[slide]"])
    best = fitter.fit(right, range(2), x=np.array([1.0 / STIFFNESS]))
    beside = best.starts + np.array([[0.0, 8e-6], [0.0, 0.0]])
    aside = fitter.fit(right, range(2), x=best.x, starts=beside, iterations=0)
    assert aside.loss[0] > best.loss[0] + SETTINGS.held_out.stuck_loss
    first = contend(fitter, aside)
    other = replace(first, fit=best)
    found = unstuck([first, other], {id(aside): aside, id(best): best}, fitter)
    assert found[id(aside)].loss[0] == pytest.approx(best.loss[0], abs=0.5)
    np.testing.assert_array_equal(found[id(aside)].starts[1], aside.starts[1])
    assert found[id(best)] is best


def test_starts_that_take_off_too_little_to_turn_an_order_are_left_alone(elastic: MechanismSystem) -> None:
    """Another explanation's starts are taken where they leave less by as much as is of use, and not by less."""
    fitter = Fitter(elastic, elastic.simulator(threads=1), measure(elastic))
    right = Explanation(elastic.vocabulary.by_name["compliance[slide]"])
    best = fitter.fit(right, range(2), x=np.array([1.0 / STIFFNESS]))
    beside = best.starts + np.array([[0.0, 8e-6], [0.0, 0.0]])
    aside = fitter.fit(right, range(2), x=best.x, starts=beside, iterations=0)
    gain, offered = aside.total - best.total, np.stack([aside.starts, best.starts], axis=1)
    begin = begun_elsewhere(fitter, aside, offered, 0.9 * gain)
    assert begin is not None
    np.testing.assert_array_equal(begin, best.starts)
    assert begun_elsewhere(fitter, aside, offered, 1.1 * gain) is None
