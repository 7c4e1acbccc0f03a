"""Did an estimate converge? Asked of the run's own measurements, without the truth.

The local body is sent through the last intervals between two messages once more, from each measured state, with the
final estimate. What it misses there, and how that hangs on the parameters, is one step of Gauss and Newton: how far the
estimate is from where the measurements have it, and how well they know. An estimate has converged where that step is
within its own uncertainty: what the measurements leave open, and what a single message's noise does to a rule that
states none. An estimate that nothing was told of has not converged either.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc  # of scipy.stats' import every command would wait for a second

from runner.errors import ConfigError
from runner.estimation.belief import observable
from runner.estimation.copies import STATE, Copies, from_values
from runner.estimation.data import measured_sd
from runner.estimation.joint import PriorConfig
from runner.estimation.watch import INTERVAL
from runner.physics import dry_friction
from runner.physics.scene import BodyConfig, SceneConfig
from runner.teleop.estimators import Compared
from runner.teleop.experiment import REMOTE, Experiment, commands
from runner.teleop.frames import RunResult, Status
from runner.teleop.parameters import FRICTION, MASS, PARAMETERS, YAW_INERTIA, values_of

RESOLVED = 0.01  # the coarsest of the errors that a run's table asks for; relative, of the half size for the CoM
FEW = 120  # of the last intervals are asked first; where they tell nothing, all are
SLOWEST = 1e-3  # m/s, rad/s: below it the remote is at rest
DELTA = 1e-4  # of the vector of parameters
COLUMNS = ("x_m", "y_m", "yaw_rad", "vx_m_s", "vy_m_s", "wz_rad_s")
CHANNELS = {Compared.linear: slice(3, 5), Compared.angular: slice(5, 6), Compared.both: slice(3, 6)}
SURE = 1e-3  # chance at which what is missed is no noise any more
STATED = ("mass_sd_share", "com_x_sd_m", "com_y_sd_m", "yaw_inertia_sd_share", "friction_sd_share")


@dataclass(frozen=True)
class Intervals:
    """Between two messages while the remote was pushed and moved, in their order.

    Attributes:
        begin, end: Measured states, (k, 6).
        pushes: Commands over the steps of each, (n_i, 12).
    """

    begin: np.ndarray
    end: np.ndarray
    pushes: tuple[np.ndarray, ...]

    def last(self, count: int) -> Intervals:
        """Return the last ones."""
        return Intervals(self.begin[-count:], self.end[-count:], self.pushes[-count:])


def unconverged(experiment: Experiment, result: RunResult) -> dict[str, str]:
    """Return for each estimator whose estimate did not converge why; for scenes that are not planar nothing is said.

    Args:
        experiment: What was run.
        result: What it left; of a run that blew up nothing is said either.
    """
    if result.reason or not result.update_count:
        return {}
    try:
        copies = _copies(experiment.scene, experiment.remote.half_size_m, experiment.local.com_m[2])
    except ConfigError:
        return {}
    found = _intervals(experiment, result)
    reasons = {name: _unconverged(experiment, result, copies, found, name) for name in experiment.estimator}
    return {name: reason for name, reason in reasons.items() if reason}


def judged(experiment: Experiment, result: RunResult) -> RunResult:
    """Return the result of a run with the status that its estimates give it."""
    reasons = unconverged(experiment, result)
    if not reasons:
        return result
    return replace(result, status=Status.unconverged, reason="; ".join(f"{k}: {v}" for k, v in reasons.items()))


@functools.lru_cache(maxsize=4)  # to compile takes longer than to step; the runs of a sweep share one
def _copies(scene: SceneConfig, half_size_m: tuple[float, float, float], height_m: float) -> Copies:
    """Return copies of a body; what else it is, each of them is told when it is run."""
    return Copies(scene, BodyConfig(1.0, 0.3, half_size_m, (0.0, 0.0, height_m)))


def _intervals(experiment: Experiment, result: RunResult) -> Intervals:
    """Return what was measured of the remote while it was pushed and moved."""
    frames = result.updates
    ends, sent_s = frames.column("frame"), frames.column("sent_s")
    arrived = sent_s[np.isfinite(sent_s)] / experiment.scene.timestep_s
    taken = np.unique(np.searchsorted(ends, np.round(arrived).astype(np.int64)))
    states = np.column_stack([frames.column(f"{REMOTE}_{column}") for column in COLUMNS])
    rng = np.random.default_rng([experiment.seed, 2])  # the link's own noise once more
    states = states + experiment.link.noise.draws(len(states), 2, 1, rng)
    states = np.vstack([np.zeros((1, STATE)), states[taken]])
    at = np.concatenate([[0], ends[taken]])
    pushes = commands(experiment).pushes[:-1, dry_friction.PUSH_SIZE : 2 * dry_friction.PUSH_SIZE]
    pushed = np.concatenate([[0], np.cumsum(pushes.any(axis=1))])
    speed = np.abs(states[:, 3:]).max(axis=1)
    told = np.flatnonzero((pushed[at[1:]] > pushed[at[:-1]]) & (np.maximum(speed[1:], speed[:-1]) > SLOWEST))
    return Intervals(states[told], states[told + 1], tuple(pushes[at[k] : at[k + 1]] for k in told))


@dataclass(frozen=True)
class _Fit:
    """What intervals say of the final values, in units of the vector of parameters, for those that are estimated.

    Attributes:
        step: From the final values to where the intervals have them, (p,).
        sd: How well they know, by the noise alone, (p,).
        spread: What is missed at the end of the step, against the noise; at least 1.
        sd_of_one: How well a single interval knows, (p,).
        contradicted: Whether what is missed at the final values is more than noise.
    """

    step: np.ndarray
    sd: np.ndarray
    spread: float
    sd_of_one: np.ndarray
    contradicted: bool


def _unconverged(experiment: Experiment, result: RunResult, copies: Copies, found: Intervals, name: str) -> str:
    """Return why the estimate of one estimator did not converge, "" if it did."""
    rule = experiment.estimator[name]
    if not len(found.begin):
        return "the remote was never seen to move under a push"
    final = {p: float(result.updates.column(f"{name}_{p}")[-1]) for p in rule.names}
    prior_sd, stated = _of(PriorConfig().sd, rule.names), _stated(result, name, experiment)
    for some in (found.last(FEW), found):
        try:
            fit = _fit(experiment, copies, some, final, CHANNELS[rule.compared])
        except FloatingPointError:
            return "a body of the values that it ends at can't be simulated"
        told = observable(fit.sd, prior_sd)
        if told.all():
            break
    own = fit.sd_of_one if stated is None else stated
    allowed = RESOLVED + INTERVAL * np.hypot(fit.spread * fit.sd, own)
    # what an estimator itself calls unknown has no value that could have converged
    known = told if stated is None else told & observable(stated, prior_sd)
    far = np.flatnonzero(known & ~(np.abs(fit.step) <= allowed))
    if len(far):
        j = far[np.argmax(np.abs(fit.step[far]) / allowed[far])]
        stem, _, unit = rule.names[j].rpartition("_")
        ends = f"{stem} ends at {final[rule.names[j]]:.3g} {unit}"
        return f"{ends}, the last pushes have it {_far(float(fit.step[j]))}, allowed: {100 * allowed[j]:.2g} %"
    if told.all() or stated is not None:
        return ""
    stem = rule.names[int(np.flatnonzero(~told)[0])].rpartition("_")[0]
    if fit.contradicted:
        return f"with the {stem} that it ends at the body moves otherwise than the remote"
    return f"the pushes tell nothing of the {stem}"


def _far(step: float) -> str:
    size = f"{100 * abs(step):.2g} %" if abs(step) < 1 else "far"
    return f"{size} {'higher' if step > 0 else 'lower'}"


def _fit(experiment: Experiment, copies: Copies, some: Intervals, final: Mapping[str, float], channels: slice) -> _Fit:
    """Return what some intervals say of the final values, see `_Fit`."""
    tried = _beside(experiment, final)
    ends = _sent_through(copies, tried, some)[..., channels]  # (p + 1, k, c)
    sd = math.sqrt(2.0) * measured_sd(experiment.link.noise)[channels]  # of both ends
    missed = ((some.end[:, channels] - ends[0]) / sd).ravel()
    slopes = ((ends[1:] - ends[0]) / DELTA / sd).reshape(len(final), -1).T
    normal = slopes.T @ slopes + np.diag(_of(PriorConfig().sd, tuple(final)) ** -2.0)
    covariance = np.linalg.inv(normal)
    step = covariance @ slopes.T @ missed
    left = missed - slopes @ step
    spread = max(1.0, float(np.sqrt((left**2).sum() / max(len(left) - len(final), 1))))
    one = np.linalg.inv(normal / len(some.begin))
    noise = float(chdtrc(len(missed), (missed**2).sum()))
    return _Fit(step, np.sqrt(np.diag(covariance)), spread, np.sqrt(np.diag(one)), noise < SURE)


def _beside(experiment: Experiment, final: Mapping[str, float]) -> np.ndarray:
    """Return the final values as vectors of parameters, then those beside them, (p + 1, 5)."""
    body = experiment.local
    start = values_of(body)
    values = start | dict(final)
    follows = MASS in final and YAW_INERTIA not in final
    if follows:  # eq. 3 of the paper
        values[YAW_INERTIA] *= final[MASS] / start[MASS]
    values[FRICTION] = max(values[FRICTION], 1e-6)
    x = np.tile(from_values(np.array([values[p] for p in PARAMETERS]), body.half_size_m), (len(final) + 1, 1))
    for row, name in enumerate(final, start=1):
        x[row, PARAMETERS.index(name)] += DELTA
        if name == MASS and follows:
            x[row, PARAMETERS.index(YAW_INERTIA)] += DELTA
    return x


def _sent_through(copies: Copies, x: np.ndarray, some: Intervals) -> np.ndarray:
    """Return where bodies of each of the parameters (q, 5) come to from the beginning of each interval, (q, k, 6)."""
    out = np.empty((len(x), len(some.begin), STATE))
    lengths = np.array([len(p) for p in some.pushes])
    for length in np.unique(lengths):
        those = np.flatnonzero(lengths == length)
        pushes = np.array([some.pushes[k] for k in those])
        states = copies.run(
            np.repeat(x, len(those), axis=0), np.tile(some.begin[those], (len(x), 1)), np.tile(pushes, (len(x), 1, 1))
        )
        out[:, those] = states.reshape(len(x), len(those), STATE)
    return out


def _stated(result: RunResult, name: str, experiment: Experiment) -> np.ndarray | None:
    """Return the standard deviations that an estimator itself states at the end, (p,); None: it states none."""
    frames, rule = result.updates, experiment.estimator[name]
    columns: dict[str, str] = {p: f"{name}_{column}" for p, column in zip(PARAMETERS, STATED, strict=True)}
    if any(columns[p] not in frames.columns for p in rule.names):
        return None
    half_x, half_y = experiment.remote.half_size_m[:2]
    scale: dict[str, float] = dict(zip(PARAMETERS, (1.0, half_x, half_y, 1.0, 1.0), strict=True))
    return np.array([frames.column(columns[p])[-1] / scale[p] for p in rule.names])


def _of(vector: np.ndarray, names: Sequence[str]) -> np.ndarray:
    return vector[[PARAMETERS.index(name) for name in names]]
