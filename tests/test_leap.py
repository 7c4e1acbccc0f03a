"""Several effects at once: what the linear model proposes, and what all of a kind share."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence, Set
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from runner.effects.vocabulary import Candidate
from runner.inference.evidence import directions, moved_along, sensitivities
from runner.inference.leap import Linear, gain_of, leap
from runner.inference.least_squares import NONE, Explanation, Fit, Fitter
from runner.noise.measured import measure
from runner.report import words
from runner.settings import SETTINGS
from runner.systems.mechanism import MechanismSystem
from runner.systems.mechanism.stretches import _longer_steps
from tests.mechanism_cases import system_of, write_case
from tests.servo_arm import JOINTS, NOMINAL, recorded, written


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> MechanismSystem:
    """Servos of 0.8 times the believed stiffness, both of them, and a forearm of 1.3 times the believed mass."""
    world = written(8.0, 0.52)
    episodes = [recorded(world, seed, samples=151, step_s=2e-4) for seed in range(3)]
    folder = write_case(tmp_path_factory.mktemp("arm"), written(10.0, 0.4), episodes, NOMINAL)
    return system_of(folder)


def test_a_gain_is_that_of_the_model_without_its_own_mismatch() -> None:
    """Against the same sum computed anew for each direction, of columns whose sizes differ a thousandfold."""
    random = np.random.default_rng(0)
    columns = random.normal(size=(500, 6)) * [1, 1e3, 30, 1e2, 5, 10]
    residual = columns @ [0, 0.1, 0, 0.02, 0, 0] + random.normal(size=500)
    spread = np.full(6, 1e-3)
    gram, right = columns.T @ columns, columns.T @ residual
    metric, gradient, _ = Linear(gram, right, spread).beside()
    for i in range(6):
        without = np.where(np.arange(6) == i, 0.0, spread)
        h, g, _ = Linear(gram, right, without).beside()
        assert gain_of(metric, gradient, np.array([i]), spread) == pytest.approx(
            g[i] ** 2 / (h[i, i] + SETTINGS.fit.information_ridge), rel=1e-6
        )


def test_two_causes_are_found_in_one_leap(arm: MechanismSystem) -> None:
    """Both at once, from the model without either, and what both servos share as one number."""
    fitter = Fitter(arm, arm.simulator(threads=1), measure(arm))
    episodes = [0]
    nominal = fitter.fit(NONE, episodes, iterations=20)
    every = directions(arm)
    worth = 0.03 * fitter.measured.count(episodes)
    fit, _ = leap(fitter, nominal, every, sensitivities(fitter, nominal, every), lambda _: worth)
    assert nominal.total > 100 * fitter.measured.count(episodes)
    assert fit.total < 1.1 * fitter.measured.count(episodes)
    assert fit.explanation.names == ("mass[forearm]", "servo_gain[*]")
    values = {e.full_name: e.report() for e in fit.explanation.make(fit.x, fitter.context)}
    assert values["servo_gain[shoulder]"] == values["servo_gain[elbow]"]
    assert values["servo_gain[elbow]"]["ratio"] == pytest.approx(0.8, abs=0.002)
    assert values["mass[forearm]"]["mass_kg"] == pytest.approx(0.52, abs=0.002)


def test_what_a_leap_pushes_out_of_range_is_taken_out_and_not_put_in_again(
    arm: MechanismSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As much mass as there may be leaves less than none; it is no cause, and nothing is put beside it."""
    fitter = Fitter(arm, arm.simulator(threads=1), measure(arm))
    heavy, stiff = (arm.vocabulary.by_name[n][0] for n in ("mass[forearm]", "servo_gain[*]"))
    (mass,) = heavy.parameters(arm.context)
    nominal, every = fitter.fit(NONE, [0], iterations=20), directions(arm)
    asked = list[frozenset[Candidate]]()

    def proposes(_around: object, _fitter: object, _most: int, _worth: float, barred: Set[Candidate]) -> object:
        asked.append(frozenset(barred))
        return [] if barred else [(heavy, np.array([mass.upper])), (stiff, np.array([-0.2]))]

    def stays(what: Explanation, episodes: Sequence[int], *, x: np.ndarray, near: Fit, **_: object) -> Fit:
        return descent(what, episodes, x=x, near=near, iterations=0)

    descent = fitter.fit
    monkeypatch.setattr("runner.inference.leap.chosen", proposes)
    monkeypatch.setattr("runner.inference.leap._needed", lambda _fitter, fit, _worth: fit)
    monkeypatch.setattr("runner.inference.leap._split", lambda _fitter, fit: fit)
    monkeypatch.setattr(Fitter, "fit", lambda _self, *a, **k: stays(*a, **k))
    fit, _ = leap(fitter, nominal, every, sensitivities(fitter, nominal, every), lambda _: -np.inf)
    assert fit.explanation.names == ("servo_gain[*]",)
    assert asked == [frozenset(), {heavy}]


def test_with_another_account_of_the_noise_nothing_is_simulated_again(arm: MechanismSystem) -> None:
    """What every effect does around a fit is what a fresh survey says, to the last digit, once it is whitened anew."""
    fitter = Fitter(arm, arm.simulator(threads=1), measure(arm))
    nominal, every = fitter.fit(NONE, [0], iterations=2), directions(arm)
    sensitivities(fitter, nominal, every)
    before_s = fitter.simulator.simulated_s
    noisier = replace(fitter, measured=replace(fitter.measured, sensor=1.5 * fitter.measured.sensor))
    again = sensitivities(noisier, nominal, every)
    assert fitter.simulator.simulated_s == before_s
    fresh = sensitivities(replace(noisier, surveys=deque(maxlen=1)), nominal, every)
    assert fitter.simulator.simulated_s > before_s
    for a, b in zip(again.columns, fresh.columns, strict=True):
        np.testing.assert_array_equal(a, b)


def test_steps_of_surveys_divide_or_hold_the_sample_period() -> None:
    """About half of the one before, none above 10 ms, none that is no longer than those of fits."""
    assert _longer_steps(0.01, 0.01 / 3) == pytest.approx([0.01, 0.005])
    assert _longer_steps(0.02, 0.002) == pytest.approx([0.01, 0.005, 0.0025])
    assert _longer_steps(0.004, 0.004 / 3) == pytest.approx([0.008, 0.004, 0.002])
    assert _longer_steps(0.001, 0.001) == pytest.approx([0.01, 0.005, 0.002])
    assert _longer_steps(0.05, 0.01) == []


def test_what_all_share_is_one_effect(arm: MechanismSystem) -> None:
    """It has a name, words, a place beside others, and as many effects as targets."""
    shared = arm.vocabulary.by_name["servo_gain[*]"][0]
    alone = arm.vocabulary.by_name["servo_gain[elbow]"][0]
    assert shared.targets == JOINTS
    assert shared.each[1] == alone
    assert [e.full_name for e in shared.make([0.1], arm.context)] == ["servo_gain[shoulder]", "servo_gain[elbow]"]
    assert not shared.may_join((alone,))
    assert not alone.may_join((shared,))
    assert alone.may_join((arm.vocabulary.by_name["servo_gain[shoulder]"][0],))
    assert shared.may_join((arm.vocabulary.by_name["mass[forearm]"][0],))
    assert Explanation((shared,)).names == ("servo_gain[*]",)
    phrase = words.phrase(arm, "servo_gain[*]", {"ratio": 0.8}, {"ratio": 0.01})
    assert phrase.what.endswith("and so it is with elbow")
    assert phrase.amount == "kp is 0.800 ± 0.010 times the believed 10.0"
    assert phrase.remedy == 'Set <position name="shoulder" kp="8"/>. The same for elbow.'
    assert words.title(["servo_gain[*]"]) == "servo gain of all"
    # what is believed to differ from joint to joint has no one value
    assert "mass[*]" not in arm.vocabulary.by_name


def test_what_one_of_a_kind_does_beside_all_is_told_around_what_all_have(arm: MechanismSystem) -> None:
    """More damping of the elbow, where all joints are held to have more: what they have does not vanish there."""
    fitter = Fitter(arm, arm.simulator(threads=1), measure(arm))
    of_all, of_elbow = (arm.vocabulary.by_name[f"joint_damping[{target}]"][0] for target in ("*", "elbow"))
    step = next(d for d in directions(arm) if d.candidate == of_elbow)
    x = np.array([0.3])
    moved = {e.full_name: e.report() for e in moved_along(step, Explanation((of_all,)), x, arm.context)}
    before = {e.full_name: e.report() for e in Explanation((of_all,)).make(x, arm.context)}
    assert len(moved) == len(JOINTS)
    assert moved["joint_damping[shoulder]"] == before["joint_damping[shoulder]"]
    more = moved["joint_damping[elbow]"]["damping"] - before["joint_damping[elbow]"]["damping"]
    assert more == pytest.approx(step.vector[0])
    fit = fitter.fit(Explanation((of_all,)), range(3), x=x, iterations=0)
    # a tenth of the step does a tenth: were it a jump from what all have, it would not
    small = replace(step, vector=0.1 * step.vector, per=0.1 * step.per)
    known = sensitivities(fitter, fit, [step, small])
    one, tenth = np.concatenate(known.columns).T
    np.testing.assert_allclose(tenth, one, atol=0.02 * np.abs(one).max())


def test_a_shared_ratio_says_what_was_believed_of_each(tmp_path: Path) -> None:
    """Of servos that are believed unlike, the first one's kp and kv are not said of the others."""
    unlike = written(10.0, 0.4).replace('joint="elbow"/></act', 'joint="elbow" kp="25" kv="1"/></act')
    arm = system_of(write_case(tmp_path, unlike, [recorded(unlike, 0, samples=101, step_s=1e-3)], NOMINAL))
    for name, gain, of in (("servo_gain", "kp", (8.0, 20.0)), ("servo_damping", "kv", (0.32, 0.8))):
        phrase = words.phrase(arm, f"{name}[*]", {"ratio": 0.8}, {"ratio": 0.01})
        assert phrase.amount == f"{gain} is 0.800 ± 0.010 times the believed one of each"
        assert phrase.remedy == " ".join(
            f'Set <position name="{j}" {gain}="{v:g}"/>.' for j, v in zip(JOINTS, of, strict=True)
        )
