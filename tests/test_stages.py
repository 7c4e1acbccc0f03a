"""What several effects do together does not hang on the order in which they are named."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np

from runner.effects.base import Effects, Stage
from runner.effects.vocabulary import Candidate
from runner.inference.least_squares import Fitter
from runner.noise.measured import measure
from runner.systems.base import AbstractSystem
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run
from tests.cases import made
from tests.mechanism_cases import slide_case, system_of

SAME = 1e-9  # of a metre, a radian, or what they are by the second


def sized(candidate: Candidate, system: AbstractSystem) -> Effects:
    """Return an effect that is plain to see."""
    starts = candidate.starts(system.context)
    if len(starts):
        return candidate.make(starts[0], system.context)
    parameters = candidate.parameters(system.context)
    return candidate.make(np.array([np.clip(0.5 * p.scale, p.lower, p.upper) for p in parameters]), system.context)


def told_apart_by_order(system: AbstractSystem, candidates: Iterable[Candidate]) -> Sequence[tuple[str, str]]:
    """Return the pairs of effects that show the first episode otherwise if they are named in turn."""
    simulator = system.simulator(threads=1)
    start = Fitter(system, simulator, measure(system)).first_starts([0])[0]
    out = []
    for a, b in combinations(candidates, 2):
        if not a.may_join([b]):
            continue
        one, other = sized(a, system), sized(b, system)
        moved = simulator.predict(0, [Run(one + other, start), Run(other + one, start)])
        if np.abs(moved[0] - moved[1]).max() > SAME:
            out.append((a.name, b.name))
    return out


def test_a_box_is_moved_alike_in_whatever_order_effects_are_named() -> None:
    """A constant force is neither weakened by a gain nor late with a push."""
    recording, _ = made(episodes=2, seconds=1.0)
    system = PlanarBox(recording)
    assert told_apart_by_order(system, [*system.vocabulary, *system.vocabulary.uncertain]) == []


def test_an_axis_shows_the_same_in_whatever_order_effects_are_named(tmp_path: Path) -> None:
    """A lag smooths what the dead band has left; the zero of a sensor is not scaled with what it reads."""

    def pushed(t: np.ndarray) -> np.ndarray:
        return 6.0 * np.sign(np.sin(9.0 * t))

    def swung(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return 0.1 - 0.1 * np.cos(9.0 * t), 0.9 * np.sin(9.0 * t)

    case = slide_case(tmp_path, command=pushed, motion=swung, friction=1.0, damping=1.0, length_s=1.0)
    system = system_of(case)
    on_signals = [c for c in system.vocabulary if not c.targets and c.effect.stage is not Stage.BESIDES]
    assert len(on_signals) > 5
    assert told_apart_by_order(system, on_signals) == []
