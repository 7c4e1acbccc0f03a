"""Recursive estimation of a body's ten inertial parameters together with its motion and the wrench on it.

Everything is measured with noise, the wrench that drives the motion too: least squares on the regressor would be
biased (errors in variables). What is unknown is therefore the motion at the beginning, the ten numbers, and every
wrench. Given those, the motion follows; pose, velocity, acceleration and wrench are all measurements of it. The filter
holds the motion now, the ten numbers and the wrench now, (28,), steps them to the next reading along its wrench, and
adds what is read. It drops past wrenches by marginalising, which loses nothing: in the linear model its estimate is
that of the batch problem with all of them as unknowns.

What is nonlinear enough to matter are the ten numbers: an extended filter linearises early readings where they were
still badly known, and that stays in its covariance. Here all readings are linearised around one point of the numbers,
and each at the wrench on which the measured wrench and acceleration agree (Deming 1943): at the measured one alone the
estimate is drawn to one side, measured by a quarter of its standard deviation. Motions are taken as they were believed
when they passed, which leaves about a tenth of a standard deviation between this and the batch answer. Where the
estimate has moved from it so far that the second order would matter, the history is gone through again from the
beginning, around the estimate (Gauss-Newton; the prior remains what it was). That happens early; with growing
certainty it ends, and an update costs the same at any time.

Without a wrench neither the mass nor the size of the inertia leaves a trace in the motion. As all readings share one
point of linearisation, the two directions are the same for all of them, and the filter makes up nothing along them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from runner.errors import RecordingError, check_range
from runner.estimation.space.dynamics import (
    MOTION,
    WRENCH,
    Body,
    Motion,
    accelerations,
    body_of,
    slopes,
    step_with_sensitivities,
    times,
)
from runner.estimation.space.inertial import SIZE, derivative, shares_of, values_of
from runner.estimation.space.readings import READ, Reading, SpacePrior

NUMBERS = slice(MOTION, MOTION + SIZE)
HELD = slice(MOTION + SIZE, MOTION + SIZE + WRENCH)
UNKNOWNS = MOTION + SIZE + WRENCH
_STRIDE = 1.0  # the longest way of the ten numbers from one point of linearisation to the next
_PLAUSIBLE = 5.0  # so many standard deviations a reading may lead where it is linearised
_ROUNDS = 4  # so often a history is gone through in one update


@dataclass(frozen=True)
class SpaceBelief:
    """What is believed after some readings, of N lanes. Never written to.

    Attributes:
        prior: Of the ten numbers, before the history: mean (N, 10) and covariance (10, 10) or (N, 10, 10).
        history: Readings, and whether each begins an episode.
        point: Where the ten numbers are linearised, (N, 10), and the `body` there.
        motion: Estimate of the motion now.
        shift: Estimate of the ten numbers less `point`, (N, 10).
        lead: The same as far as is known from all of the history, (N, 10): where the history is gone through again, the
            shift begins at the prior, while the point is the best that is known.
        wrench: Estimate of the wrench now, at the tracked point, (N, 6).
        covariance: Of motion, numbers and wrench, (N, 28, 28).
        gone: Length of the history when it was last gone through, (N,).
        surprise: Squared whitened innovation of the last reading, (N,), and of how many numbers, (N,).
    """

    prior: tuple[np.ndarray, np.ndarray]
    history: tuple[tuple[Reading, bool], ...]
    point: np.ndarray
    body: Body
    motion: Motion
    shift: np.ndarray
    lead: np.ndarray
    wrench: np.ndarray
    covariance: np.ndarray
    gone: np.ndarray
    surprise: tuple[np.ndarray, np.ndarray]

    @property
    def x(self) -> np.ndarray:
        """Estimated free numbers, (N, 10)."""
        return self.point + self.shift

    @property
    def x_covariance(self) -> np.ndarray:
        """Of the free numbers, (N, 10, 10)."""
        return self.covariance[:, NUMBERS, NUMBERS]


@dataclass(frozen=True)
class SpaceTracker:
    """Makes beliefs. All methods are pure.

    Args:
        half_size_m: Of the body, (3,): the unit of its free numbers.
        step_s: Between readings.
        noise_sd: Of a reading beside its wrench, (18,): position, turn, velocity, rate, specific force, angular
            acceleration.
        wrench_root: A root of the covariance of a measured wrench, carried to the tracked point, (6, 6).
        to_point: What carries a wrench from the grip to the tracked point, (6, 6).
        gravity: (3,), m/s2, world.
        tolerance: A point of linearisation is kept while the square of the way to the estimate is this share of the
            least standard deviation of the ten numbers.
        growth: The history must have grown by this factor before it is gone through again.
    """

    half_size_m: np.ndarray
    step_s: float
    noise_sd: np.ndarray
    wrench_root: np.ndarray
    to_point: np.ndarray
    gravity: np.ndarray
    tolerance: float = 0.1
    growth: float = 1.5

    def __post_init__(self) -> None:
        check_range("step_s", self.step_s, 0.0, 1.0, unit="s", lower_open=True)
        for value in self.noise_sd:
            check_range("noise", float(value), 0.0, 1e4, lower_open=True)

    def start(self, prior: SpacePrior, first: Reading) -> SpaceBelief:
        """Return what is believed after the first reading.

        Raises:
            RecordingError: If part of its pose or velocity did not arrive.
        """
        n = len(first.acceleration)
        mean = np.broadcast_to(prior.x, (n, SIZE)).copy()
        empty = SpaceBelief(
            prior=(mean, prior.covariance),
            history=(),
            point=mean,
            body=body_of(mean, self.half_size_m),
            motion=first.motion,
            shift=np.zeros((n, SIZE)),
            lead=np.zeros((n, SIZE)),
            wrench=np.zeros((n, WRENCH)),
            covariance=np.zeros((n, UNKNOWNS, UNKNOWNS)),
            gone=np.zeros(n),
            surprise=(np.zeros(n), np.zeros(n)),
        )
        empty = replace(empty, covariance=self._of_prior(empty))
        return self.begun(empty, first)

    def begun(self, belief: SpaceBelief, first: Reading) -> SpaceBelief:
        """Return what is believed after the first reading of a new episode: the body is the same, its motion another.

        Raises:
            RecordingError: If part of its pose or velocity did not arrive.
        """
        if any(np.isnan(part).any() for part in first.motion):
            raise RecordingError("reading: the first one of an episode must have a pose and a velocity.")
        entered = self._entered(replace(belief, lead=belief.shift), first)
        return self._improved(replace(entered, history=(*belief.history, (first, True))))

    def update(self, belief: SpaceBelief, reading: Reading) -> SpaceBelief:
        """Return what is believed after the next reading of the same episode."""
        later = self._advanced(replace(belief, lead=belief.shift), reading)
        return self._improved(replace(later, history=(*belief.history, (reading, False))))

    def values(self, belief: SpaceBelief, *, held: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Return estimated values and their covariance.

        Mass, centre of mass and inertia, (N, 10) and (N, 10, 10), in the order of `inertial.NAMES`; where the body was
        never held, what does not hang on its density, (N, 9) and (N, 9, 9), in the order of `inertial.SHARES`.
        """
        function = values_of if held else shares_of
        by = derivative(function, belief.x, self.half_size_m)
        return function(belief.x, self.half_size_m), by @ belief.x_covariance @ by.swapaxes(-1, -2)

    @staticmethod
    def _of_prior(belief: SpaceBelief) -> np.ndarray:
        out = np.zeros_like(belief.covariance)
        out[:, NUMBERS, NUMBERS] = belief.prior[1]
        return out

    def _wrench(self, reading: Reading) -> tuple[np.ndarray, np.ndarray]:
        """Return the wrench at the tracked point, (N, 6), and its covariance, (6, 6)."""
        if reading.wrench is None:
            return np.zeros((len(reading.acceleration), WRENCH)), np.zeros((WRENCH, WRENCH))
        return times(self.to_point, reading.wrench), self.wrench_root @ self.wrench_root.T

    def _entered(self, belief: SpaceBelief, first: Reading) -> SpaceBelief:
        """Return the belief after the first reading of an episode."""
        covariance = np.zeros_like(belief.covariance)
        covariance[:, NUMBERS, NUMBERS] = belief.x_covariance
        covariance[:, range(MOTION), range(MOTION)] = self.noise_sd[:MOTION] ** 2
        wrench, covariance[:, HELD, HELD] = self._wrench(first)
        # pose and velocity are in it by now: what else was read is added
        none = Motion(*(np.full_like(part, np.nan) for part in first.motion))
        entered = replace(belief, motion=first.motion, wrench=wrench, covariance=covariance)
        near = self._near(belief, first.motion.rate, wrench, covariance[0, HELD, HELD], first.acceleration)
        return self._told(entered, Reading(none, first.acceleration), near)

    def _advanced(self, belief: SpaceBelief, reading: Reading) -> SpaceBelief:
        """Return the belief one step later, after what is read then."""
        n = len(belief.point)
        wrench, spread = self._wrench(reading)
        turning = accelerations(belief.body, belief.motion.rate, belief.wrench)[:, 3:]
        near = self._near(belief, belief.motion.rate + self.step_s * turning, wrench, spread, reading.acceleration)
        motion, by = step_with_sensitivities(
            belief.body, belief.motion, (belief.wrench, near), self.step_s, self.gravity
        )
        forward = np.zeros((n, UNKNOWNS, UNKNOWNS))
        forward[:, :MOTION] = by[..., :UNKNOWNS]
        forward[:, NUMBERS, NUMBERS] = np.eye(SIZE)
        new = np.zeros((n, UNKNOWNS, WRENCH))
        new[:, :MOTION] = by[..., UNKNOWNS:]
        new[:, HELD] = np.eye(WRENCH)
        covariance = forward @ belief.covariance @ forward.swapaxes(-1, -2) + new @ spread @ new.swapaxes(-1, -2)
        moved = motion.moved(times(by[..., NUMBERS], belief.shift) + times(by[..., UNKNOWNS:], wrench - near))
        return self._told(replace(belief, motion=moved, wrench=wrench, covariance=covariance), reading, near)

    def _near(
        self, belief: SpaceBelief, rate: np.ndarray, wrench: np.ndarray, spread: np.ndarray, acceleration: np.ndarray
    ) -> np.ndarray:
        """Return the wrench (N, 6) at which a reading is linearised: what wrench and acceleration make likely together.

        At the measured wrench alone, the error of the derivatives by the ten numbers would go with that of what is
        expected, and the estimate would be drawn to one side, as of a regression whose regressors are noisy.
        """
        expected = accelerations(belief.body, rate, wrench)
        residual = acceleration - expected - times(slopes(belief.body, rate, expected).numbers, belief.lead)
        arrived = ~np.isnan(residual)
        by = belief.body.inverse * arrived[..., None]
        across = spread @ by.swapaxes(-1, -2)
        both = by @ across + np.diag(self.noise_sd[MOTION:] ** 2)
        residual = np.where(arrived, residual, 0.0)
        white = np.linalg.solve(both, residual[..., None])[..., 0]
        # what noise can't be is the error of the numbers, and moves no wrench
        distance = np.sqrt((residual * white).sum(axis=1, keepdims=True))
        return wrench + times(across, white) * np.minimum(1.0, _PLAUSIBLE / np.maximum(distance, 1e-300))

    def _told(self, belief: SpaceBelief, reading: Reading, near: np.ndarray) -> SpaceBelief:
        """Return the belief with a reading added; its wrench is in it already, `near` is where it is linearised."""
        body, motion = belief.body, belief.motion
        acceleration = accelerations(body, motion.rate, near)
        slope = slopes(body, motion.rate, acceleration)
        expected = acceleration + times(slope.numbers, belief.shift) + times(slope.wrench, belief.wrench - near)
        known = np.asarray(np.isfinite(reading.motion.turn).all(axis=(-1, -2)))
        turn = np.where(known[:, None, None], reading.motion.turn, motion.turn)
        residual = np.concatenate([reading.motion._replace(turn=turn).less(motion), reading.acceleration - expected], 1)
        residual[:, 3:6] = np.where(known[:, None], residual[:, 3:6], np.nan)
        by = np.zeros((len(residual), READ, UNKNOWNS))
        by[:, range(MOTION), range(MOTION)] = 1.0
        by[:, MOTION:, 9:MOTION], by[:, MOTION:, NUMBERS], by[:, MOTION:, HELD] = slope
        arrived = ~np.isnan(residual)
        residual = np.where(arrived, residual, 0.0) / self.noise_sd
        by = by / self.noise_sd[:, None] * arrived[..., None]
        across = belief.covariance @ by.swapaxes(-1, -2)
        spread = by @ across + np.eye(READ)
        solved = np.linalg.solve(spread, np.concatenate([across.swapaxes(-1, -2), residual[..., None]], axis=-1))
        gain, white = solved[..., :-1].swapaxes(-1, -2), solved[..., -1]
        change = times(gain, residual)
        covariance = belief.covariance - gain @ across.swapaxes(-1, -2)
        return replace(
            belief,
            motion=motion.moved(change[:, :MOTION]),
            shift=belief.shift + change[:, NUMBERS],
            wrench=belief.wrench + change[:, HELD],
            covariance=0.5 * (covariance + covariance.swapaxes(-1, -2)),
            surprise=((residual * white).sum(axis=1), arrived.sum(axis=1).astype(float)),
        )

    def _improved(self, belief: SpaceBelief) -> SpaceBelief:
        """Return the belief linearised anew where the second order would matter."""
        due = np.flatnonzero(len(belief.history) >= self.growth * belief.gone)
        for _ in range(_ROUNDS):
            due = due[self._far(belief)[due]]
            if not len(due):
                break
            again = self._gone_through(lanes_of(belief, due))
            belief = with_lanes(belief, due, again)
        return belief

    def _far(self, belief: SpaceBelief) -> np.ndarray:
        """Return which lanes are too far from where they are linearised, (N,)."""
        least = np.sqrt(np.maximum(np.linalg.eigvalsh(belief.x_covariance)[:, 0], 0.0))
        return (belief.shift**2).sum(axis=1) > self.tolerance * least

    def _gone_through(self, belief: SpaceBelief) -> SpaceBelief:
        """Return the belief linearised around its estimate, or as far towards it as is safe."""
        way = np.linalg.norm(belief.shift, axis=1, keepdims=True)
        point = belief.point + belief.shift * np.minimum(1.0, _STRIDE / np.maximum(way, 1e-300))
        new = replace(belief, point=point, body=body_of(point, self.half_size_m), shift=belief.prior[0] - point)
        new = replace(new, lead=np.zeros_like(point), covariance=self._of_prior(new))
        for reading, begins in belief.history:
            new = self._entered(new, reading) if begins else self._advanced(new, reading)
        return replace(new, gone=np.full(len(point), float(len(belief.history))), surprise=belief.surprise)


def lanes_of(belief: SpaceBelief, lanes: np.ndarray) -> SpaceBelief:
    """Return the belief of some lanes."""
    if len(lanes) == len(belief.point):
        return belief
    return replace(
        belief,
        prior=(belief.prior[0][lanes], belief.prior[1]),
        history=tuple((reading.of(lanes), begins) for reading, begins in belief.history),
        body=belief.body.of(lanes),
        motion=belief.motion.of(lanes),
        surprise=(belief.surprise[0][lanes], belief.surprise[1][lanes]),
        **{name: getattr(belief, name)[lanes] for name in _PER_LANE},
    )


_PER_LANE = ("point", "shift", "lead", "wrench", "covariance", "gone")


def with_lanes(belief: SpaceBelief, lanes: np.ndarray, other: SpaceBelief) -> SpaceBelief:
    """Return the belief with some of its lanes replaced by those of another, history and surprise aside."""

    def put(into: np.ndarray, values: np.ndarray) -> np.ndarray:
        out = into.copy()
        out[lanes] = values
        return out

    return replace(
        belief,
        body=Body(*(put(a, b) for a, b in zip(belief.body, other.body, strict=True))),
        motion=Motion(*(put(a, b) for a, b in zip(belief.motion, other.motion, strict=True))),
        **{name: put(getattr(belief, name), getattr(other, name)) for name in _PER_LANE},
    )
