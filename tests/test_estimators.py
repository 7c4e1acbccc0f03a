"""The published rules on a point mass whose motion is known in closed form, and on what they must not use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from runner.config import options
from runner.errors import ConfigError
from runner.physics.scene import BodyConfig, SceneConfig
from runner.teleop.estimators import Linear, LinearGuarded, Outcome, Rotational, Seen, Setup, compare

CUTS = (slice(0, 3), slice(0, 2), slice(2, 3))
LOCAL_CUTS = (slice(3, 6), slice(3, 5), slice(5, 6))
G, T = 9.81, 1 / 60
TRUE_KG = 3.0


def seen(
    local: tuple[float, float], remote: tuple[float, float], impulse: float = 0.0, turning: tuple[float, float] = (0, 0)
) -> Seen:
    """Return what a rule sees: velocities along x and y, push impulse along x, turning rates of local and remote."""
    v = [remote[0], remote[1], turning[1], local[0], local[1], turning[0]]
    q = [0.0] * 6
    return Seen(T, T, 0.0, (impulse, 0.0, 0.0), q, v, q, v, q, [0.0] * 6, LOCAL_CUTS, CUTS)


@dataclass(frozen=True)
class Slide:
    """A mass that slides along +x through an interval from a common speed."""

    start_m_s: float
    force_n: float
    mu: float

    def end(self, mass_kg: float) -> float:
        """Speed at the end of the interval, as long as it does not stop within."""
        return self.start_m_s + (self.force_n / mass_kg - self.mu * G) * T

    def seen(self, mass_kg: float) -> Seen:
        """What is seen after it."""
        return seen((self.end(mass_kg), 0), (self.end(TRUE_KG), 0), self.force_n * T)

    @property
    def rho(self) -> float:
        """Share of the remote's speed that the push did not make."""
        return (self.start_m_s - self.mu * G * T) / self.end(TRUE_KG)


SLIDES = st.builds(Slide, st.floats(0, 3), st.floats(-30, 60), st.floats(0, 1))


@given(SLIDES, st.floats(0.3, 9))
def test_the_error_is_multiplied_by_rho(slide: Slide, mass_kg: float) -> None:
    """m' - M = rho (m - M), whatever start speed, push, friction and mass, while both slide."""
    assume(slide.end(mass_kg) > 2e-3 and slide.end(TRUE_KG) > 2e-3)
    new, outcome = Linear(lowest_kg=1e-9, highest_kg=1e6).update(mass_kg, slide.seen(mass_kg))
    assert outcome is Outcome.updated
    assert new - TRUE_KG == pytest.approx(slide.rho * (mass_kg - TRUE_KG), abs=1e-9 * (1 + abs(new)))


@given(st.floats(1, 60), st.floats(0.01, 100))
def test_without_friction_one_update_from_rest_is_exact(force_n: float, mass_kg: float) -> None:
    """On ice v_local / v_remote = M / m after the first interval."""
    new, _ = Linear(slowest_m_s=1e-9).update(mass_kg, Slide(0.0, force_n, 0.0).seen(mass_kg))
    assert new == pytest.approx(TRUE_KG, rel=1e-12)


def test_starting_from_rest_overshoots_beyond_the_start_error() -> None:
    """With A < mu g, a start of a sixth of the mass becomes more than twice the mass: the early peak."""
    slide = Slide(0.0, 15.0, 0.3)
    assert slide.rho == pytest.approx(-0.3 * G / (5 - 0.3 * G))
    new, _ = Linear().update(0.5, slide.seen(0.5))
    assert new > 2 * TRUE_KG
    guarded, outcome = LinearGuarded().update(0.5, slide.seen(0.5))
    assert outcome is Outcome.updated
    assert guarded == pytest.approx(TRUE_KG, rel=1e-12)


@given(SLIDES, st.floats(0.3, 9))
def test_the_guard_never_increases_the_error(slide: Slide, mass_kg: float) -> None:
    """Whatever the push, the guarded rule ends as near to the true mass as it was, or nearer, on the same side."""
    assume(slide.end(mass_kg) > 2e-3 and slide.end(TRUE_KG) > 2e-3)
    new, _ = LinearGuarded().update(mass_kg, slide.seen(mass_kg))
    assert abs(new - TRUE_KG) <= abs(mass_kg - TRUE_KG) * (1 + 1e-9) + 1e-9
    assert (new - TRUE_KG) * (mass_kg - TRUE_KG) >= -1e-7


def test_braking_by_a_push_makes_errors_grow_and_is_held_by_the_guard() -> None:
    """A push against the motion has rho > 1: eq. 2 moves away from the truth, the guarded rule stays."""
    slide = Slide(1.0, -20.0, 0.1)
    assert slide.rho > 1
    assert Linear().update(2.0, slide.seen(2.0))[0] < 2.0
    assert LinearGuarded().update(2.0, slide.seen(2.0)) == (2.0, Outcome.not_driven)


def test_gliding_says_nothing() -> None:
    """Without a push both slow down alike, and the mass stays as it is."""
    slide = Slide(1.0, 0.0, 0.3)
    assert Linear().update(1.7, slide.seen(1.7))[0] == 1.7
    assert LinearGuarded().update(1.7, slide.seen(1.7)) == (1.7, Outcome.not_driven)


@pytest.mark.parametrize("rule", [Linear(), LinearGuarded()])
@pytest.mark.parametrize(
    ("local", "remote", "outcome"),
    [
        ((0.0, 0.0), (0.0, 0.0), Outcome.at_rest),
        ((0.0, 0.0), (0.5, 0.0), Outcome.at_rest),  # the local one sticks: the ratio would make the mass zero
        ((0.5, 0.0), (0.0, 0.0), Outcome.at_rest),  # the remote one sticks: the ratio would be infinite
        ((1e-7, 0.0), (2e-7, 0.0), Outcome.at_rest),  # creep
        ((0.2, 0.0), (-0.1, 0.0), Outcome.opposed),
        ((0.3, 0.0), (0.0, 0.3), Outcome.opposed),
    ],
)
def test_the_linear_rules_hold_where_speeds_say_nothing(
    rule: Linear | LinearGuarded, local: tuple[float, float], remote: tuple[float, float], outcome: Outcome
) -> None:
    """At rest, while one sticks, while creeping, and in opposite directions the mass stays what it was."""
    assert rule.update(1.3, seen(local, remote, 0.25)) == (1.3, outcome)


def test_rotation_scales_by_the_turning_rates() -> None:
    """Eq. 5 uses the rates alone, in either direction, and holds when they are small or opposed."""
    rule = Rotational()
    assert rule.update(1.0, seen((0, 0), (9, 9), turning=(-0.6, -0.2)))[0] == pytest.approx(3.0)
    assert rule.update(1.0, seen((1, 0), (2, 0), turning=(0.0, 0.0))) == (1.0, Outcome.at_rest)
    assert rule.update(1.0, seen((1, 0), (2, 0), turning=(0.3, -0.3))) == (1.0, Outcome.opposed)
    assert rule.update(1.0, seen((1, 0), (2, 0), turning=(1e-4, 0.3))) == (1.0, Outcome.at_rest)


def test_implausible_results_are_refused() -> None:
    """A result outside the allowed range is not clipped: the estimate stays, and the outcome says why."""
    rule = Linear(lowest_kg=0.5, highest_kg=5.0)
    assert rule.update(1.0, seen((9.0, 0), (1.0, 0))) == (1.0, Outcome.implausible)
    assert rule.update(1.0, seen((0.1, 0), (1.0, 0))) == (1.0, Outcome.implausible)


def test_a_rule_starts_from_the_local_cube() -> None:
    """The memory before the first update is the start mass."""
    setup = Setup(SceneConfig(), BodyConfig(1.25, 0.3))
    assert [rule.values(rule.start(setup)) for rule in (Linear(), Rotational(), LinearGuarded())] == [(1.25,)] * 3


@given(st.lists(st.floats(-5, 5), min_size=3, max_size=3), st.floats(0.01, 100))
def test_compare_is_the_ratio_of_lengths(vector: list[float], factor: float) -> None:
    """For parallel vectors it is their ratio; turned about, it says so; where one is slow, it is 0."""
    size = sum(x * x for x in vector) ** 0.5
    assume(size > 1e-6)
    longer = [factor * x for x in vector]
    assert compare(longer, vector, 1e-9) == pytest.approx(factor, rel=1e-9)
    assert compare(longer, [-x for x in vector], 1e-9) == -1
    assert compare(longer, vector, 2 * max(size, factor * size)) == 0


def test_wrong_values_are_refused() -> None:
    """Limits must be positive and in order."""
    with pytest.raises(ConfigError, match="slowest_m_s"):
        Linear(slowest_m_s=0.0)
    with pytest.raises(ConfigError, match="highest_kg"):
        Rotational(lowest_kg=2.0, highest_kg=1.0)


def test_every_estimator_stands_in_a_file() -> None:
    """Each registered estimator is offered by a YAML file, by itself or around another's rule."""
    text = "\n".join(p.read_text() for p in (Path(__file__).parents[1] / "conf" / "estimator").glob("*.yaml"))
    assert [name for name in options("estimator") if f"schema_{name}@" not in text] == []
