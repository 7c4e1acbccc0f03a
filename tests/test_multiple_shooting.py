"""Parts of episodes, each with a start state of its own: simulated exactly, searched first, and cut at breakaways."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from runner.effects import planar_box as fx
from runner.effects.vocabulary import Candidate
from runner.inference.breakaway import hanging
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.inference.multiple_shooting import carried, explains, look
from runner.inference.search import search
from runner.inference.warm_start import Beginning, WarmStart, key_of
from runner.noise.measured import measure
from runner.recording import Episode, Form, Recording, Span
from runner.systems.planar_box.simulator import Simulator, context_of
from runner.systems.planar_box.system import PlanarBox
from runner.systems.planar_box.windows import Effects
from runner.systems.simulator import Run
from tests.cases import NOMINAL, RATE_HZ, fitter_of, measured_as

FRICTION_N = 0.3 * 3.0 * 9.81


def pushed(forces: Sequence[np.ndarray], effects: Sequence[Effects], seed: int = 5) -> Recording:
    """Episodes under forces (T, 2) off the centre, from rest, each with effects of its own, with noise."""
    rng = np.random.default_rng(seed)
    made = []
    for i, force in enumerate(forces):
        n = len(force)
        blank, push, point = np.zeros((n, 3)), np.zeros((n, 3)), np.full((n, 3), [0.1, 0.05, 0.0])
        push[:, :2] = force
        made.append(Episode(i, np.arange(n) / RATE_HZ, blank, blank, push, point))
    return measured_as(Recording(Path("made"), Form.PLANAR, NOMINAL, tuple(made)), effects, rng, grid=8)


def random_pushes(count: int, seconds: float, seed: int = 1) -> list[np.ndarray]:
    """Pushes of half a second with pauses, in all directions."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(count):
        force = np.zeros((int(seconds * RATE_HZ) + 1, 2))
        for begin in range(10, len(force) - 40, 60):
            angle = rng.uniform(-math.pi, math.pi)
            force[begin : begin + 30] = rng.uniform(13, 20) * np.array([math.cos(angle), math.sin(angle)])
        out.append(force)
    return out


@pytest.mark.parametrize(
    "effects",
    [
        (),
        (fx.ActuatorLag(0.2), fx.MassLeak(0.1)),
        # whole steps, so that what is shown is the state itself
        (fx.ActuatorDelay(8 / RATE_HZ), fx.Wind(2.0, 0.3)),
        (fx.ObservationDelay(3 / RATE_HZ), fx.ActuatorGain(1.2)),
    ],
)
def test_a_part_moves_as_the_whole_does_there(effects: Effects) -> None:
    """From the whole's state at its first sample; what was commanded before still acts, and the mass leaks on."""
    recording = pushed(random_pushes(2, 3.0), [()] * 2)
    whole = Simulator(recording, grid=8, threads=1)
    parts = whole.parts([Span(1, 0, 50), Span(1, 70, 150)]).parts([Span(1, 5, 80), Span(0, 0, 50)])
    run = Run((), np.array([0.2, -0.1, 0.4, 0.3, -0.2, 0.5]))
    one = whole.predict(1, [Run(effects, run.start)])[0]
    assert np.array_equal(parts.predict(1, [Run(effects, run.start)])[0], one[:50])
    assert parts.predict(0, [Run(effects, one[75])])[0] == pytest.approx(one[75:150], abs=1e-9)


@pytest.mark.parametrize("threads", [1, 2])
def test_episodes_side_by_side_move_as_each_does_alone(threads: int) -> None:
    """Of whatever length, with whatever each is asked for; nothing is asked of one."""
    recording = pushed(random_pushes(2, 3.0), [()] * 2)
    spans = [Span(1, 0, 150), Span(0, 20, 80), Span(1, 5, 152), Span(0, 0, 60)]
    simulator = Simulator(recording, grid=8, threads=threads).parts(spans)
    start = np.array([0.2, -0.1, 0.4, 0.3, -0.2, 0.5])
    late, leaking, spring = (fx.ObservationDelay(0.05),), (fx.ActuatorLag(0.2),), (fx.Tether(5.0, 1.0, 0.0),)
    runs = [[Run(late, start), Run((), -start)], [Run((), start)], [Run(leaking, start), Run(spring, start)], []]
    each = simulator.predict_each(list(enumerate(runs)))
    for k, shown in enumerate(each):
        assert shown.shape == (len(runs[k]), spans[k].end - spans[k].begin, 6)
        for run, row in zip(runs[k], shown, strict=True):
            np.testing.assert_array_equal(row, simulator.predict(k, [run])[0])


def test_measured_parts_keep_what_hangs() -> None:
    """The first sample that hangs on a breakaway is counted from where a part begins; the earliest counts."""
    recording = pushed(random_pushes(2, 2.0), [()] * 2)
    measured = measure(PlanarBox(recording)).without({1: 60}).without({1: 80, 0: 100})
    assert measured.hung == {1: 60, 0: 100}
    assert measured.counted(1)[:60].all()
    assert not measured.counted(1)[60:].any()
    assert measured.count([1]) == 60 * 6
    parts = measured.parts([Span(1, 0, 50), Span(1, 50, 121), Span(1, 70, 121), Span(0, 0, 50)])
    assert [parts.count([i]) for i in range(4)] == [300, 60, 0, 300]
    white = measured.whiten(1, np.ones((121, 6)))
    assert not white[60:].any()
    assert white[:60].all()


@pytest.mark.slow
def test_a_look_at_pieces_finds_what_acts_late() -> None:
    """A slack tether that stiffens far from the start: the nominal model is metres off, and the look comes near it."""
    tether = fx.Tether(6.0, 0.3, -0.2, 0.8)
    recording = pushed(random_pushes(3, 5.0), [(tether,)] * 3)
    fitter = fitter_of(recording)
    nominal = fitter.fit(NONE, range(3))
    assert nominal.total > 10 * fitter.measured.count(range(3))
    seen = look(fitter, nominal)
    assert seen is not None
    seed = seen.beginning.seeds[(Candidate(fx.Tether),)]
    assert seed.total < 2 * fitter.measured.count(range(3))
    found = seed.explanation.make(seed.x, fitter.context)[0].report()
    for key, true in tether.report().items():
        assert found[key] == pytest.approx(true, rel=0.2, abs=0.1), key
    assert not seen.hung
    # another is not worth a fit of its own any more
    assert (Candidate(fx.Inertia),) in seen.beginning.ruled_out


@pytest.mark.slow
def test_what_does_not_show_in_pieces_is_found_on_the_whole() -> None:
    """A Stribeck effect that was found without the inertia beside it goes astray over whole episodes, and leaps."""
    recording = pushed(random_pushes(5, 7.0), [(fx.Stribeck(-0.3, 0.3), fx.Inertia(0.95))] * 5)
    fitter = fitter_of(recording)
    starts, count = fitter.fit(NONE, range(5)).starts, fitter.measured.count(range(5))
    alone, x = Explanation((Candidate(fx.Stribeck),)), np.array([-0.42, 0.16, np.log(2.0)])
    seed = WarmStart(alone, x, starts, fitter.loss(alone, x, starts, range(5)))
    assert seed.total > 10 * count
    whole = carried(fitter, seed, range(5), fitter.longest_s(range(5)))
    assert whole.explanation == alone
    assert 1.1 * count < whole.total < seed.total
    best = search(fitter, range(5), starts=starts, beginning=Beginning({key_of(alone): whole})).best.fit
    assert set(best.explanation.names) == {"stribeck", "inertia"}
    assert best.total < 1.1 * count
    inertia = next(e for e in best.explanation.make(best.x, fitter.context) if e.name == "inertia")
    assert inertia.report()["ratio"] == pytest.approx(0.95, abs=0.01)


def test_what_is_out_of_its_range_explains_nothing() -> None:
    """A Stribeck effect of the least speed stands in for static friction, a tether without slack for nothing else."""
    recording = pushed(random_pushes(2, 2.0), [()] * 2)
    fitter, context = fitter_of(recording), context_of(recording)
    starts, count = np.zeros((2, 6)), fitter.measured.count(range(2))
    _, speed, exponent = fx.Stribeck.parameters(context)
    stiffness, x, _, slack = fx.Tether.parameters(context)
    for kind, vector, total, holds in (
        (fx.Stribeck, [0.3, speed.lower, 0.0], 0.9 * count, False),
        (fx.Stribeck, [0.3, speed.lower + 0.1, 0.0], 0.9 * count, True),
        (fx.Stribeck, [0.3, speed.lower + 0.1, exponent.upper], 0.9 * count, True),
        (fx.Stribeck, [0.3, speed.lower + 0.1, 0.0], 1.6 * count, False),
        (fx.Tether, [stiffness.scale, 0.5 * (x.lower + x.upper), 0.0, slack.lower], 0.9 * count, True),
        (fx.Tether, [stiffness.scale, x.upper, 0.0, slack.lower], 0.9 * count, False),
    ):
        seed = WarmStart(Explanation((Candidate(kind),)), np.array(vector), starts, total)
        assert explains(seed, fitter, range(2)) is holds


def test_no_look_where_the_nominal_model_holds() -> None:
    """There is nothing to be learnt from pieces."""
    fitter = fitter_of(pushed(random_pushes(3, 3.0), [()] * 3))
    assert look(fitter, fitter.fit(NONE, range(3))) is None


def test_what_is_too_short_to_be_cut_is_looked_at_from_its_beginning() -> None:
    """As far as its first half, which the nominal model follows longer."""
    fitter = fitter_of(pushed(random_pushes(3, 0.95), [(fx.ActuatorGain(1.5),)] * 3))
    seen = look(fitter, fitter.fit(NONE, range(3)))
    assert seen is not None
    assert seen.cut_s is None
    assert min(s.total for s in seen.beginning.seeds.values()) < 1.2 * fitter.measured.count(range(3))


def on_the_edge(measured_excess: float) -> tuple[Fitter, int]:
    """Three episodes with static friction; the last has a push of 1.3 times friction that starts there, or doesn't."""
    strong, edge = random_pushes(2, 4.0), np.zeros((241, 2))
    edge[10:60, 0] = 16.0
    edge[150:200, 0] = 1.3 * FRICTION_N
    excesses = [(fx.Stiction(e),) for e in (0.29, 0.29, measured_excess)]
    recording = pushed([*strong, edge], excesses)
    return fitter_of(recording), 150


def starting_excess() -> float:
    """The static friction above which the push of `on_the_edge` does not start the body, by bisection."""
    low, high = 0.05, 0.6

    def starts(excess: float) -> bool:
        fitter, begin = on_the_edge(excess)
        return bool(np.abs(fitter.measured.values[2][begin + 45 : begin + 50, 3:5]).max() > 0.2)

    assert starts(low)
    assert not starts(high)
    while high - low > 1e-3:
        low, high = (mid, high) if starts(mid := (low + high) / 2) else (low, mid)
    return (low + high) / 2


def test_what_hangs_on_a_breakaway_is_told_from_what_is_wrong() -> None:
    """A push that a floor 1 % less even would not have let start is not fitted from there on; a wrong model is."""
    edge = starting_excess()
    fitter, begin = on_the_edge(edge - 0.004)
    explanation = Explanation((Candidate(fx.Stiction),))
    held = dataclasses.replace(fitter, held=(fx.Stiction(edge + 0.004),))
    starts = held.fit(NONE, range(3)).starts
    stuck = fitter.fit(explanation, range(3), x=np.array([edge + 0.004]), starts=starts, iterations=0)
    hung = hanging(fitter, stuck)
    assert list(hung) == [2]
    assert begin - 2 <= hung[2] < begin + 30
    # far from the edge it is the model that is wrong
    far = fitter.fit(explanation, range(3), x=np.array([edge + 0.15]), starts=starts, iterations=0)
    assert not hanging(fitter, far)
    # and no other effect has a breakaway to hang on
    assert not hanging(fitter, fitter.fit(Explanation((Candidate(fx.Friction),)), range(3), iterations=2))


def test_a_channel_that_is_never_measured_does_not_forbid_pieces() -> None:
    """One that is missing from a piece alone does: its start could not be told."""
    recording = pushed(random_pushes(2, 2.0), [()] * 2)
    fitter = fitter_of(recording)
    valid = [v.copy() for v in fitter.measured.valid]
    for v in valid:
        v[:, 5] = False
    without = dataclasses.replace(fitter, measured=dataclasses.replace(fitter.measured, valid=tuple(valid)))
    assert without.pieces(0.5, range(2)) == fitter.pieces(0.5, range(2))
    valid[0][:40, 0] = False
    gap = dataclasses.replace(fitter, measured=dataclasses.replace(fitter.measured, valid=tuple(valid)))
    assert gap.pieces(0.5, range(2)) == [s for s in fitter.pieces(0.5, range(2)) if (s.episode, s.begin) != (0, 0)]
