"""Where a box is replayed in parts: where its motion amplifies what is small."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from runner.effects import planar_box as fx
from runner.effects.planar_box import stribeck
from runner.recording import Span
from runner.systems.planar_box.simulator import context_of
from runner.systems.planar_box.system import PlanarBox
from tests.cases import RATE_HZ, made
from tests.test_multiple_shooting import pushed

NEAR_FRICTION_N, PLAIN_N = 6.2, 15.0  # dry friction of the believed box is 8.8 N, of the slippery one 5.9 N


def held_pushes(force_n: float, count: int = 4, seconds: float = 5.0) -> list[np.ndarray]:
    """One long push off the middle each, in some direction."""
    rng = np.random.default_rng(1)
    out = []
    for angle in rng.uniform(-3, 3, count):
        force = np.zeros((round(seconds * RATE_HZ) + 1, 2))
        force[10:] = force_n * np.array([math.cos(angle), math.sin(angle)])
        out.append(force)
    return out


def test_a_box_that_is_pushed_hard_answers_in_proportion() -> None:
    """Its friction is little beside the push, and small differences stay small: episodes are replayed whole."""
    system = PlanarBox(pushed(held_pushes(PLAIN_N), [()] * 4))
    assert system.stretches() == tuple(Span(e, 0, 301) for e in range(4))


def test_a_box_that_is_hardly_pushed_enough_is_replayed_in_parts() -> None:
    """The believed one does not move, which tells nothing; the one that is found turns by a hair's breadth."""
    slippery = (fx.Friction(0.2),)
    system = PlanarBox(pushed(held_pushes(NEAR_FRICTION_N), [slippery] * 4))
    assert len(system.stretches()) == 4
    parts = system.stretches(slippery)
    assert len(parts) > 4
    for e in range(4):
        own = [s for s in parts if s.episode == e]
        assert [s.begin for s in own] == [0, *(s.end for s in own[:-1])]
        assert own[-1].end == 301


@pytest.mark.parametrize("speed_m_s", [0.05, 0.66, 3.0])
def test_friction_bends_at_speeds_that_were_recorded(speed_m_s: float) -> None:
    """A law that bends above all of them is plain friction with numbers more."""
    recording, _ = made(episodes=1)
    context = context_of(recording)
    slow = type(context)(context.mass_kg, context.friction, context.half_size_m, 9.81, speed_m_s=speed_m_s)
    upper = fx.Stribeck.parameters(slow)[1].upper
    assert fx.Stribeck.from_vector([0.2, upper, 0.0], slow).speed_m_s == pytest.approx(speed_m_s)
    starts = fx.Stribeck.starts(slow)
    assert len(starts)
    assert (starts[:, 1] < upper).all()
    assert stribeck.SLOWEST_M_S < 0.05


def test_the_fastest_that_a_box_moved_is_seen_through_noise_and_glitches() -> None:
    """By the way over a tenth of a second; one position that is a metre off is a glitch."""
    recording, _ = made(episodes=2)
    fastest = context_of(recording).speed_m_s
    shown = max(float(np.linalg.norm(e.twist[:, :2], axis=1).max()) for e in recording.episodes)
    assert fastest == pytest.approx(shown, rel=0.1)
    first, *others = recording.episodes
    pose = first.pose.copy()
    pose[50, 0] += 1.0
    spoilt = replace(recording, episodes=(replace(first, pose=pose), *others))
    assert context_of(spoilt).speed_m_s == pytest.approx(fastest, rel=0.02)
