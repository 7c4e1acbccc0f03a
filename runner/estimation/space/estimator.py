"""The estimator in space as a setting, and one lane of it under watch: frozen where it is certain, free on a change.

The rule is that of the planar one, see `estimation.watch`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from runner.errors import ConfigError, check_range
from runner.estimation.space.inertial import NAMES, SHARES, Inertial, shares_of, to_vector, units_of, values_of
from runner.estimation.space.readings import Reading, SensorConfig, SpacePrior
from runner.estimation.space.tracker import SpaceBelief, SpaceTracker
from runner.estimation.watch import INTERVAL, LIMIT, excess_after
from runner.teleop.link import NoiseConfig


@dataclass(frozen=True)
class SpaceEstimator:
    """Mass, centre of mass and inertia in space, with their uncertainty.

    Attributes:
        sensors: What to expect of accelerations and of the wrench at the grip.
        scale: How far the density may be from what is believed: standard deviation of its logarithm.
        shape: How far size and place of the mass may be, in half sizes.
        certain: The estimate is frozen once the 95 % interval of every value is within this share (of the half size for
            the centre of mass, of the mean moment for the inertia), and set free again when the readings no longer fit;
            None: never frozen.
    """

    sensors: SensorConfig = field(default_factory=SensorConfig)
    scale: float = math.log(2)
    shape: float = 0.3
    certain: float | None = None

    def __post_init__(self) -> None:
        check_range("scale", self.scale, 0.0, 10.0, lower_open=True)
        check_range("shape", self.shape, 0.0, 10.0, lower_open=True)
        if self.certain is not None:
            check_range("certain", self.certain, 0.0, 1.0, lower_open=True)

    def tracker(self, half_size_m: np.ndarray, step_s: float, noise: NoiseConfig, gravity: np.ndarray) -> SpaceTracker:
        """Return what makes beliefs of readings at equal steps."""
        sensors = self.sensors
        return SpaceTracker(half_size_m, step_s, sensors.sd(noise), sensors.wrench_root, sensors.to_point, gravity)

    def prior(self, body: Inertial, half_size_m: np.ndarray) -> SpacePrior:
        """Return the prior with this body in its middle.

        Raises:
            ConfigError: If there can't be such a body.
        """
        return SpacePrior(numbers_of(body, half_size_m), self.scale, self.shape)


def numbers_of(body: Inertial, half_size_m: np.ndarray) -> np.ndarray:
    """Return the ten free numbers of a body, (10,).

    Raises:
        ConfigError: If no distribution of mass has its mass, centre of mass and inertia.
    """
    try:
        return to_vector(body, half_size_m)
    except np.linalg.LinAlgError:
        moments = np.linalg.eigvalsh(body.inertia_kg_m2)
        raise ConfigError(
            "inertia: no body has these principal moments: each must be above 0 and below the sum of the others, got "
            f"{', '.join(f'{m:.4g}' for m in moments)} kg m2."
        ) from None


@dataclass(frozen=True)
class SpaceWatched:
    """A belief of one lane under watch.

    Attributes:
        belief: What is believed.
        prior: Where the belief begins anew, its uncertainty is this one's.
        held: Whether the body was held since the belief began: without a force, only what does not hang on mass and
            size of the inertia is told, and frozen.
        frozen: Free numbers (10,) that are given out while they are frozen; None: they are not.
        excess: Cumulative sum of surprise.
        alarms: How often the body was found changed.
    """

    belief: SpaceBelief
    prior: SpacePrior
    held: bool
    frozen: np.ndarray | None = None
    excess: float = 0.0
    alarms: int = 0

    @property
    def names(self) -> tuple[str, ...]:
        """Of the values."""
        return NAMES if self.held else SHARES


@dataclass(frozen=True)
class SpaceWatch:
    """Updates beliefs under watch; `certain` as in `SpaceEstimator`."""

    tracker: SpaceTracker
    certain: float | None

    def start(self, prior: SpacePrior, first: Reading) -> SpaceWatched:
        """Return what is believed after the first reading, of one lane."""
        return SpaceWatched(self.tracker.start(prior, first), prior, first.wrench is not None)

    def begun(self, watched: SpaceWatched, first: Reading) -> SpaceWatched:
        """Return what is believed after the first reading of a new episode."""
        belief = self.tracker.begun(watched.belief, first)
        held = watched.held or first.wrench is not None
        # other values from now on: what was frozen had fewer
        frozen = watched.frozen if held == watched.held else None
        return replace(watched, belief=belief, held=held, frozen=frozen)

    def update(self, watched: SpaceWatched, reading: Reading) -> SpaceWatched:
        """Return what is believed after the next reading."""
        after = replace(watched, belief=self.tracker.update(watched.belief, reading))
        if self.certain is None:
            return after
        if watched.frozen is None:
            values, sd = self.values(after), self.sd(after)
            certain = (INTERVAL * sd <= self.certain * units_of(values, self.tracker.half_size_m)).all()
            return replace(after, frozen=after.belief.x[0] if certain else None)
        # a motion that was badly known is no surprise: only what is frozen is watched
        (surprise,), (count,) = after.belief.surprise
        excess = excess_after(watched.excess, surprise, count)
        if excess <= LIMIT or any(np.isnan(part).any() for part in reading.motion):  # to begin anew takes all of it
            return replace(after, excess=excess)
        prior = replace(watched.prior, x=watched.frozen)
        return replace(self.start(prior, reading), alarms=watched.alarms + 1)

    def values(self, watched: SpaceWatched) -> np.ndarray:
        """Return the values that are given out, in the order of their `names`."""
        if watched.frozen is None:
            return self.tracker.values(watched.belief, held=watched.held)[0][0]
        return (values_of if watched.held else shares_of)(watched.frozen, self.tracker.half_size_m)

    def sd(self, watched: SpaceWatched) -> np.ndarray:
        """Return the standard deviations of what is believed, in the order of their `names`."""
        (covariance,) = self.tracker.values(watched.belief, held=watched.held)[1]
        return np.sqrt(np.maximum(np.diagonal(covariance), 0.0))
