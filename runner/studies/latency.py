"""Whether late, jittered and lost messages bias the estimate: many seeds, each with links and noise of its own.

A message is compared with what was predicted for the time of its sending (`teleop.latency`). Two estimators do so.
The joint one sees measurements with noise: mass, centre of mass, yaw inertia and friction, each seed with its own
noise, delays and losses. Each seed is run twice, the second time with the opposite noise (antithetic variates,
Hammersley and Morton 1956): an error that is linear in the noise cancels in the mean of such a pair, and what remains
is the bias. So few seeds tell it better than many single runs could. The published rule (eq. 2) runs in the closed loop
without noise, aware of the delay and unaware of it, so that what is left is the latency's alone.

The remote moves as commanded, whatever the local side makes of it: it is simulated once. Delays shift when an estimate
is known, not what it is; what is lost, or overtaken, is missing in it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from runner.config import registered
from runner.errors import check_range
from runner.estimation.belief import Prior
from runner.estimation.copies import Copies, errors, to_vector
from runner.estimation.data import measured_sd
from runner.estimation.tracker import Tracker
from runner.physics import dry_friction
from runner.progress import progress
from runner.storage.writing import write_parquet
from runner.studies.base import AbstractStudy, Rows
from runner.teleop.batch import run_batch
from runner.teleop.experiment import Experiment, commands
from runner.teleop.follow import Immediate, Unaware
from runner.teleop.frames import RunResult
from runner.teleop.link import LinkConfig, NoiseConfig, arrivals, taken_in
from runner.teleop.loop import run
from runner.teleop.parameters import PARAMETERS
from runner.teleop.sinks import RrdSink

POSE = ("x_m", "y_m", "yaw_rad", "vx_m_s", "vy_m_s", "wz_rad_s")
LANES = 50  # side by side
NOISE = NoiseConfig(position_m=5e-4, angle_rad=1e-3, velocity_m_s=5e-3, rate_rad_s=1e-2)


@dataclass(frozen=True)
class Sent:
    """What arrives of the remote's states over many links.

    Attributes:
        ends: After how many steps each tick comes, (m,).
        measured: The state that was sent at each tick, with noise, (2 seeds, m, 6); NaN: not taken in. The second half
            has the opposite noise.
        overtaken: Share of the messages that were dropped because a newer one had come before.
    """

    ends: np.ndarray
    measured: np.ndarray
    overtaken: float


def sent(truth: RunResult, link: LinkConfig, seeds: list[int]) -> Sent:
    """Send the remote's states of a planar run over a link, once for each seed."""
    frames = truth.updates
    times_s = frames.column("time_s")
    states = np.column_stack([frames.column(f"remote_{name}") for name in POSE])
    measured, overtaken = np.full((2, len(seeds), *states.shape), np.nan), 0
    for i, seed in enumerate(seeds):
        tick = arrivals(link, times_s, np.random.default_rng([seed, 1]))
        taken = [message for messages in taken_in(tick) for message in messages]
        noise = link.noise.draws(len(times_s), 2, 1, np.random.default_rng([seed, 2]))
        measured[0, i, taken], measured[1, i, taken] = states[taken] + noise[taken], states[taken] - noise[taken]
        overtaken += int((tick < len(tick)).sum()) - len(taken)
    return Sent(frames.column("frame"), measured.reshape(-1, *states.shape), overtaken / (len(seeds) * len(times_s)))


def joint_errors(experiment: Experiment, given: Sent, prior_sd: np.ndarray) -> np.ndarray:
    """Return the errors of all parameters after the run, (2 seeds, 5), as `estimation.copies.errors` has them."""
    tracker = Tracker(Copies(experiment.scene, experiment.local), measured_sd(experiment.link.noise))
    pushes = commands(experiment).pushes[:-1, dry_friction.PUSH_SIZE : 2 * dry_friction.PUSH_SIZE]
    belief = tracker.start(Prior(to_vector(experiment.local), prior_sd), np.zeros((len(given.measured), 6)))
    at = 0
    for k, end in enumerate(given.ends.tolist()):
        belief = tracker.update(belief, pushes[at:end], given.measured[:, k])
        at = end
    return errors(belief.x, to_vector(experiment.remote.body))


@registered("study")
@dataclass(frozen=True)
class Latency(AbstractStudy):
    """Bias over delays.

    Attributes:
        delays_s: Of the link, in place of its own; its jitter and loss are kept.
        seeds: For each delay, with the joint estimator: a pair of runs each. No seed is used for two delays.
        closed_loops: Seeds of the published rule in the closed loop.
    """

    delays_s: tuple[float, ...] = (0.1, 0.3)
    seeds: int = 20
    closed_loops: int = 5

    def __post_init__(self) -> None:
        for i, delay in enumerate(self.delays_s):
            check_range(f"delays_s[{i}]", delay, 0.0, 10.0, unit="s")
        check_range("seeds", self.seeds, 2, 100_000)
        check_range("closed_loops", self.closed_loops, 0, 10_000)

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        quiet = replace(experiment, link=replace(experiment.link, noise=NoiseConfig()))
        out: Rows = []
        first = run(replace(quiet, link=replace(quiet.link, delay_s=self.delays_s[0])))
        RrdSink().write(first, folder, {"seed": experiment.seed})
        write_parquet(folder / "frames.parquet", first.updates.table())
        if self.closed_loops:
            out += [row for delay in self.delays_s for row in self._closed(quiet, delay)]
        truth = run(replace(quiet, link=LinkConfig(experiment.link.rate_hz)))
        with progress("Estimating", total=len(self.delays_s) * self.seeds, unit="seeds") as advance:
            for i, delay in enumerate(self.delays_s):
                link = replace(experiment.link, delay_s=delay, noise=experiment.link.noise or NOISE)
                seeds = [experiment.seed + i * self.seeds + s for s in range(self.seeds)]
                parts, overtaken = [], []
                for begin in range(0, self.seeds, LANES):
                    given = sent(truth, link, seeds[begin : begin + LANES])
                    found = joint_errors(replace(experiment, link=link), given, PRIOR_SD)
                    parts.append(found.reshape(2, -1, len(PARAMETERS)))
                    overtaken.append(given.overtaken)
                    advance(parts[-1].shape[1])
                about = _about(link) | {"overtaken_share": float(np.mean(overtaken))}
                out += _bias_rows(about, np.concatenate(parts, axis=1))
        return out

    def _closed(self, experiment: Experiment, delay_s: float) -> Rows:
        out = []
        for policy in (Immediate(), Unaware()):
            link = replace(experiment.link, delay_s=delay_s)
            runs = [
                replace(experiment, link=link, follow=policy, seed=experiment.seed + s)
                for s in range(self.closed_loops)
            ]
            results = run_batch(runs)
            name = next(iter(experiment.estimator))
            error = np.array([r.updates.column(f"{name}_mass_error")[-1] for r in results])
            behind = [r.updates.column(f"{name}_position_error_m")[len(r.updates) // 2 :] for r in results]
            out.append(
                _about(link)
                | {
                    "estimator": name,
                    "aware": not isinstance(policy, Unaware),
                    "parameter": "mass",
                    "seeds": len(runs),
                    "bias": float(error.mean()),
                    "largest_error": float(np.abs(error).max()),
                    "behind_m": float(np.sqrt(np.mean(np.square(behind)))),
                }
            )
        return out


# so uncertain are log mass, CoM per half size, log inertia and log friction beforehand
PRIOR_SD = np.array([1.0, 0.3, 0.3, 1.0, 1.0])


def _about(link: LinkConfig) -> dict[str, Any]:
    return {"delay_s": link.delay_s, "jitter_s": link.jitter_s, "loss": link.loss}


def _bias_rows(about: dict[str, Any], error: np.ndarray) -> Rows:
    """Return rows from the errors of pairs of runs, (2, seeds, 5); `se` is the standard error of one run."""
    n = error.shape[1]
    wide = float(scipy.stats.t.ppf(0.975, n - 1)) / np.sqrt(n)
    out = []
    for j, name in enumerate(PARAMETERS):
        column = error[..., j]
        middle = column.mean(axis=0)
        bias, se = float(middle.mean()), float(np.sqrt(column.var(axis=1, ddof=1).mean()))
        way = wide * float(middle.std(ddof=1))
        out.append(
            about
            | {
                "estimator": "joint",
                "aware": True,
                "parameter": name.rsplit("_", 1)[0],
                "seeds": n,
                "bias": bias,
                "se": se,
                "bias_per_se": bias / se,
                "bias_per_se_low": (bias - way) / se,
                "bias_per_se_high": (bias + way) / se,
                "largest_error": float(np.abs(column).max()),
            }
        )
    return out
