"""Calibration: choose the next push by what it will tell, until the parameters are known well enough.

A candidate push presses on one of the four faces, beside its middle or not, along the face's inward normal, with all
the force that is allowed, for one of a few durations, and is followed by a short glide. It is simulated from the
present estimate together with the copies that give its sensitivities; what its measurements will add to the
information, and what that leaves of the parameters' covariance P, follows before it is done. Chosen is the push that
lowers

    log det (P + T^2)

most per second (D-optimal; T^2 is diagonal and holds the squared uncertainties asked for: beyond them nothing is to be
gained). A start estimate that is too heavy expects no motion at all, from any push; while it is uncertain the gain is
therefore summed over the estimate and one with less mass and friction. Pushes whose motion would leave the workspace
are not taken.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from runner.errors import check_range
from runner.estimation.belief import UNKNOWNS, Belief, Prior, covariance_of
from runner.estimation.copies import FRICTION, MASS, SIZE, STATE, Copies
from runner.estimation.tracker import Tracker
from runner.estimation.watch import INTERVAL
from runner.physics.forces import CSV_COLUMNS
from runner.physics.scene import push_columns
from runner.storage.writing import replacing


@dataclass(frozen=True)
class LimitsConfig:
    """What the one who pushes can do.

    `force_n` is the force of every push. `workspace_m`: the centre stays within that of where it began, along x and y.
    `pushes_s` are the durations to choose from, `glide_s` the time after a push in which nothing is pushed. `offsets`
    are places on a face, in shares of its half width.
    """

    force_n: float = 15.0
    workspace_m: float = 1.0
    pushes_s: tuple[float, ...] = (0.2, 0.3, 0.45)
    glide_s: float = 0.25
    offsets: tuple[float, ...] = (-0.9, -0.5, 0.0, 0.5, 0.9)

    def __post_init__(self) -> None:
        check_range("force_n", self.force_n, 0.0, 1e5, unit="N", lower_open=True)
        check_range("workspace_m", self.workspace_m, 0.0, 1e3, unit="m", lower_open=True)
        check_range("glide_s", self.glide_s, 0.0, 10.0, unit="s")
        for i, value in enumerate(self.pushes_s):
            check_range(f"pushes_s[{i}]", value, 0.01, 10.0, unit="s")
        for i, value in enumerate(self.offsets):
            check_range(f"offsets[{i}]", value, -1.0, 1.0)


@dataclass(frozen=True)
class Chosen:
    """A push: commands (n, 12), glide included; force (3,), world axes; point (3,), body axes; how long; its gain."""

    columns: np.ndarray
    force_n: np.ndarray
    point_m: np.ndarray
    push_s: float
    gain: float


@dataclass(frozen=True)
class Planner:
    """Chooses pushes for a body whose messages come every `period` physics steps."""

    tracker: Tracker
    limits: LimitsConfig
    period: int
    target: float  # half width of the 95 % intervals that is asked for

    def next(self, belief: Belief, centre: np.ndarray) -> Chosen:
        """Return the best push from what is believed of one lane; `centre` (2,) is that of the workspace."""
        here = self.tracker.rebased(belief)
        state = here.mean[0, :STATE]
        plans = self._plans(float(state[2]))
        doubt = np.zeros(UNKNOWNS)
        doubt[[STATE + MASS, STATE + FRICTION]] = -1.5 * here.prior_sd[0, [MASS, FRICTION]]
        score = np.zeros(len(plans))
        for unknowns in (here.mean[0], here.mean[0] + doubt):
            gain, reach = self._judged(here, unknowns, plans, centre)
            score += np.where(reach <= self.limits.workspace_m, gain, -1e-9 * reach)
        best = int(np.argmax(score))
        return Chosen(*plans[best], gain=float(score[best]))

    def _plans(self, yaw: float) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, float]]:
        scene, half = self.tracker.copies.scene, self.tracker.copies.half_size_m
        out = []
        for face, offset, push_s in itertools.product(range(4), self.limits.offsets, self.limits.pushes_s):
            inward = -np.array([np.cos(face * np.pi / 2), np.sin(face * np.pi / 2), 0.0])
            across = np.array([-inward[1], inward[0], 0.0])
            point = (-inward + offset * across) * half * (1.0, 1.0, 0.0)
            turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
            force = self.limits.force_n * turn @ inward
            steps = self._steps(push_s)
            columns = np.zeros((steps + self._steps(self.limits.glide_s), 12))
            columns[:steps] = push_columns(force, point)
            out.append((columns, force, point, steps * scene.timestep_s))
        return out

    def _steps(self, duration_s: float) -> int:
        """Return a whole number of periods of messages, at least one."""
        return max(1, round(duration_s / self.tracker.copies.scene.timestep_s / self.period)) * self.period

    def _judged(
        self,
        here: Belief,
        unknowns: np.ndarray,
        plans: list[tuple[np.ndarray, np.ndarray, np.ndarray, float]],
        centre: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return what each plan gains per second, and how far from the centre it leads, (plans,) each."""
        count, longest = len(plans), max(len(p[0]) for p in plans)
        columns = np.zeros((count, longest, 12))
        for i, plan in enumerate(plans):
            columns[i, : len(plan[0])] = plan[0]
        messages = np.array([len(p[0]) // self.period for p in plans])
        information, reach = np.zeros((count, UNKNOWNS, UNKNOWNS)), np.zeros(count)
        foreseen = self.tracker.foreseen(np.tile(unknowns, (count, 1)), columns, self.period)
        for k, (states, told) in enumerate(foreseen):
            runs = k < messages
            information[runs] += told[runs]
            reach[runs] = np.maximum(reach[runs], np.abs(states[runs, :2] - centre).max(axis=1))
        after = covariance_of(np.repeat(here.root, count, axis=0), information)[:, STATE:, STATE:]
        asked = np.diag(np.full(SIZE, (self.target / INTERVAL) ** 2))
        before = np.linalg.slogdet(here.parameter_covariance + asked)[1]
        left = np.linalg.slogdet(after + asked)[1]
        return (before - left) / (messages * self.period * self.tracker.copies.scene.timestep_s), reach


@dataclass(frozen=True)
class Calibrated:
    """How a calibration went.

    Attributes:
        belief: What is believed at the end.
        time_s: When it ended.
        reached: Whether the asked certainty was.
        pushes: Those that were begun: (start in s, push).
        track: Estimated parameters and their standard deviations after each message, (m, 10).
        reach_m: How far the centre went from where it began, along x or y.
    """

    belief: Belief
    time_s: float
    reached: bool
    pushes: tuple[tuple[float, Chosen], ...]
    track: np.ndarray
    reach_m: float


@dataclass(frozen=True)
class Thing:
    """The object that is calibrated: simulated with its true parameters, measured with noise."""

    copies: Copies
    true_x: np.ndarray
    noise_sd: np.ndarray
    rng: np.random.Generator

    def pushed(self, state: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the true state (1, 6) after some commands (n, 12), and what is measured of it."""
        after = self.copies.run(self.true_x[None], state, columns)
        return after, after + self.noise_sd * self.rng.standard_normal(after.shape)


Source = Callable[[Belief, int], Chosen | None]


def calibrate(
    thing: Thing, tracker: Tracker, prior: Prior, source: Source, *, period: int, target: float, longest_s: float
) -> Calibrated:
    """Push a thing until its parameters are known.

    Args:
        thing: What is pushed.
        tracker: Estimates its parameters.
        prior: Where the estimate begins.
        source: The next push, from what is believed and how many steps have been taken; None: there are no more.
        period: Physics steps between messages.
        target: Half width of all 95 % intervals at which it ends.
        longest_s: It ends then in any case.
    """
    step_s = thing.copies.scene.timestep_s
    state, measured = thing.pushed(np.zeros((1, STATE)), np.zeros((0, 12)))
    belief = tracker.update(tracker.start(prior, measured), np.zeros((0, 12)), measured)
    steps, reach, reached = 0, 0.0, False
    pushes: list[tuple[float, Chosen]] = []
    told: list[np.ndarray] = []
    while not reached and steps * step_s < longest_s:
        push = source(belief, steps)
        if push is None:
            break
        pushes.append((steps * step_s, push))
        for begin in range(0, len(push.columns), period):
            columns = push.columns[begin : begin + period]
            state, measured = thing.pushed(state, columns)
            belief = tracker.update(belief, columns, measured)
            steps += len(columns)
            reach = max(reach, float(np.abs(state[0, :2]).max()))
            told.append(np.concatenate([belief.x[0], belief.sd[0]]))
            reached = bool((INTERVAL * belief.sd <= target).all())
            if reached:
                break
    return Calibrated(belief, steps * step_s, reached, tuple(pushes), np.array(told).reshape(-1, 2 * SIZE), reach)


def write_pushes(path: Path, done: Calibrated, timestep_s: float) -> None:
    """Write the pushes of a calibration as a CSV file that `forces=csv` plays."""
    rows = []
    for start_s, push in done.pushes:
        rows += [(start_s, *push.force_n, *push.point_m), (start_s + push.push_s, *[0.0] * 6)]
    start_s, push = done.pushes[-1]
    rows.append((start_s + len(push.columns) * timestep_s, *[0.0] * 6))
    table = pd.DataFrame(rows, columns=list(CSV_COLUMNS))
    with replacing(path) as part:
        table[table["t"].diff().fillna(1.0) > 0].to_csv(part, index=False)
