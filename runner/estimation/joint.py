"""The estimator of all parameters in the closed loop, and the prior that it begins with."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np

from runner.config import registered
from runner.errors import check_range
from runner.estimation.belief import Prior, observable
from runner.estimation.copies import COM_X, COM_Y, Copies, to_values, to_vector
from runner.estimation.data import measured_sd
from runner.estimation.tracker import Tracker
from runner.estimation.watch import Watch, Watched
from runner.physics.scene import BodyConfig
from runner.teleop.estimators import AbstractEstimator, Outcome, Seen, Setup
from runner.teleop.experiment import Experiment
from runner.teleop.link import NoiseConfig
from runner.teleop.loop import run
from runner.teleop.parameters import PARAMETERS
from runner.teleop.sinks import RrdSink


@dataclass(frozen=True)
class PriorConfig:
    """How far the truth may be from the start values: standard deviations, 0: known.

    Of the logarithms of mass, yaw inertia and friction (0.7: a factor of two), and of the CoM as share of the half
    size, the same along both axes.
    """

    mass: float = math.log(2)
    com: float = 0.3
    yaw_inertia: float = math.log(2)
    friction: float = math.log(2)

    def __post_init__(self) -> None:
        for name in ("mass", "com", "yaw_inertia", "friction"):
            check_range(name, getattr(self, name), 0.0, 3.0)

    @property
    def sd(self) -> np.ndarray:
        """In the order of the vector, (5,)."""
        return np.array([self.mass, self.com, self.com, self.yaw_inertia, self.friction])

    def around(self, body: BodyConfig) -> Prior:
        """Return the prior with this body in its middle."""
        return Prior(to_vector(body), self.sd)


def write_view(experiment: Experiment, folder: Path, estimators: dict[str, AbstractEstimator]) -> None:
    """Run an experiment in the closed loop with these estimators, and write its `run.rrd`."""
    alone = replace(experiment, estimator=estimators)
    RrdSink().write(run(alone), folder, {"seed": experiment.seed})


@dataclass(frozen=True)
class JointMemory:
    """What the estimator remembers: the model, the commands, up to which step it has come, and what it believes."""

    tracker: Tracker
    pushes: np.ndarray
    prior: Prior
    timestep_s: float
    step: int
    watched: Watched | None  # None: nothing has arrived yet


@registered("estimator")
@dataclass(frozen=True)
class Joint(AbstractEstimator):
    """Mass, CoM, yaw inertia and friction together, with their uncertainty (see `estimation.tracker`).

    `noise` is what to expect of the measurements. With `certain` the estimate is frozen once the 95 % interval of
    every parameter is within that share (of the half size for the CoM) of it, and set free again when the measurements
    no longer fit (see `estimation.watch`); None: never frozen.
    """

    names: ClassVar[tuple[str, ...]] = PARAMETERS
    details: ClassVar[tuple[str, ...]] = (
        "mass_sd_share", "com_x_sd_m", "com_y_sd_m", "com_xy_covariance_m2", "yaw_inertia_sd_share",
        "friction_sd_share", "observed_parameters", "frozen", "alarms",
    )  # fmt: skip
    prior: PriorConfig = field(default_factory=PriorConfig)
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    certain: float | None = None

    def __post_init__(self) -> None:
        if self.certain is not None:
            check_range("certain", self.certain, 0.0, 1.0, lower_open=True)

    def start(self, setup: Setup) -> JointMemory:
        tracker = Tracker(Copies(setup.scene, setup.body), measured_sd(self.noise))
        return JointMemory(tracker, setup.pushes, self.prior.around(setup.body), setup.scene.timestep_s, 0, None)

    def update(self, memory: JointMemory, seen: Seen) -> tuple[JointMemory, Outcome]:
        measured = np.array([[*seen.remote_position, *seen.remote_linear, *seen.remote_angular]])
        step = round(seen.sent_s / memory.timestep_s)
        watch = Watch(memory.tracker, self.certain)
        common = np.array([[*seen.common_position, *seen.common_linear, *seen.common_angular]])
        watched = memory.watched or watch.start(memory.prior, common)
        watched = watch.update(watched, memory.pushes[memory.step : step], measured)
        after = JointMemory(memory.tracker, memory.pushes, memory.prior, memory.timestep_s, step, watched)
        return after, Outcome.updated

    def values(self, memory: JointMemory) -> tuple[float, ...]:
        x = memory.prior.x if memory.watched is None else memory.watched.x[0]
        return tuple(to_values(x, memory.tracker.copies.half_size_m).tolist())

    def detail(self, memory: JointMemory) -> tuple[float, ...]:
        watched, half = memory.watched, memory.tracker.copies.half_size_m
        covariance = np.diag(memory.prior.sd**2) if watched is None else watched.belief.parameter_covariance[0]
        sd = np.sqrt(np.diagonal(covariance))
        seen = np.zeros(0) if watched is None else observable(sd, memory.prior.sd)
        return (
            sd[0],
            sd[COM_X] * half[0],
            sd[COM_Y] * half[1],
            covariance[COM_X, COM_Y] * half[0] * half[1],
            sd[3],
            sd[4],
            float(seen.sum()),
            float(watched is not None and watched.frozen is not None),
            float(0 if watched is None else watched.alarms),
        )
