"""The study `certainty`: are the stated intervals right, when does an estimate freeze, and when is it set free?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from runner.config import registered
from runner.errors import check_range
from runner.estimation.averaged import Average, Averaged
from runner.estimation.copies import FRICTION, INERTIA, MASS, STATE, Copies, to_values
from runner.estimation.data import RemoteMotion, measured_sd, motion_of
from runner.estimation.joint import Joint, PriorConfig, write_view
from runner.estimation.published import published
from runner.estimation.tracker import Tracker
from runner.estimation.watch import INTERVAL, Watch, Watched
from runner.progress import progress, track
from runner.storage.writing import write_parquet
from runner.studies.base import AbstractStudy, Rows
from runner.studies.joint import follow, share_within, short
from runner.teleop.estimators import Linear
from runner.teleop.experiment import Experiment
from runner.teleop.parameters import PARAMETERS

OVER_TIME = "over_time.parquet"
WATCHED = "watched.parquet"


@dataclass(frozen=True)
class Change:
    """What happens to the object during the run: mass (and inertia) and friction are multiplied."""

    name: str
    mass: float = 1.0
    friction: float = 1.0

    def applied(self, x: np.ndarray) -> np.ndarray:
        """Return the parameters after the change, (5,)."""
        out = x.copy()
        out[[MASS, INERTIA]] += np.log(self.mass)
        out[FRICTION] += np.log(self.friction)
        return out


CHANGES = (
    Change("none"),
    Change("mass x 1.3", mass=1.3),
    Change("mass x 0.7", mass=0.7),
    Change("friction x 1.3", friction=1.3),
    Change("friction x 0.7", friction=0.7),
)


@dataclass(frozen=True)
class _Seen:
    """What a run under watch gave out at each update, whether it was frozen, and at which updates it was set free."""

    last: Watched
    x: list[np.ndarray]
    frozen: list[bool]
    alarms: list[int]

    def followed_by(self, later: _Seen) -> _Seen:
        """Return the two as one."""
        alarms = self.alarms + [len(self.x) + k for k in later.alarms]
        return _Seen(later.last, self.x + later.x, self.frozen + later.frozen, alarms)


def _watched(watch: Watch, watched: Watched, windows: Sequence[np.ndarray], measured: np.ndarray) -> _Seen:
    """Watch over some updates; `measured` is (1, m, 6), m at least the number of windows."""
    x, frozen, alarms = [], [], []
    for k, pushes in enumerate(windows):
        before = watched.alarms
        watched = watch.update(watched, pushes, measured[:, k])
        alarms += [k] * (watched.alarms > before)
        x.append(watched.x[0])
        frozen.append(watched.frozen is not None)
    return _Seen(watched, x, frozen, alarms)


@registered("study", "certainty")
@dataclass(frozen=True)
class Certainty(AbstractStudy):
    """Intervals over many seeded runs, each with a truth of its own, drawn from the prior; freezing; averages.

    Rows by `part`:
        interval: per parameter, how often the stated 95 % interval held the truth at the end (`coverage`, with its
            95 % interval), and over all times at which the parameter was told of (`coverage_over_time`).
        freezing: per change of the object, `change_s` into the run while it is pushed: shares of runs that were
            frozen before, and set free after; the time that took (median, longest); false alarms, and later ones after
            the first right one; and the largest error at the end.
        average: the published rule, and the median and the mean of its last estimates, on the same noisy data: root
            mean square of the relative error of the mass at the end, and median over all updates.
    """

    seeds: int = 500
    watched_seeds: int = 20
    average_seeds: int = 50
    certain: float = 0.01
    change_s: float = 3.7
    prior: PriorConfig = field(default_factory=PriorConfig)

    def __post_init__(self) -> None:
        for name in ("seeds", "watched_seeds", "average_seeds"):
            check_range(name, getattr(self, name), 2, 100_000)
        check_range("certain", self.certain, 0.0, 1.0, lower_open=True)
        check_range("change_s", self.change_s, 0.0, 1e4, unit="s")

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        motion = motion_of(experiment)
        copies = Copies(experiment.scene, experiment.local)
        write_view(experiment, folder, {"joint": Joint(self.prior, experiment.link.noise, self.certain)})
        return [
            *self._intervals(experiment, motion, copies, folder),
            *self._freezing(experiment, motion, copies, folder),
            *self._averages(experiment, motion, copies),
        ]

    def _intervals(self, experiment: Experiment, motion: RemoteMotion, copies: Copies, folder: Path) -> Rows:
        tracker = Tracker(copies, measured_sd(experiment.link.noise))
        prior = self.prior.around(experiment.local)
        rng = np.random.default_rng([experiment.seed, 6])
        truth = prior.x + prior.sd * rng.standard_normal((self.seeds, len(PARAMETERS)))
        states, out = np.zeros((self.seeds, STATE)), []
        for pushes in motion.windows():
            states = copies.run(truth, states, pushes)
            out.append(states)
        noise = replace(motion, states=np.zeros_like(motion.states))
        measured = np.stack(out, axis=1) + noise.measured(
            experiment.link.noise, [experiment.seed + i for i in range(self.seeds)]
        )
        course = follow(tracker, tracker.start(prior, measured[:, 0]), motion, measured, 6, "Intervals")
        inside = np.abs(course.x - truth) <= INTERVAL * course.sd  # (k, N, 5)
        told = course.sd < 0.9 * prior.sd
        rows: Rows = []
        parts = []
        for j, parameter in enumerate(PARAMETERS):
            share, low, high = share_within(inside[-1, :, j])
            rows.append(
                {
                    "part": "interval",
                    "what": short(parameter),
                    "runs": self.seeds,
                    "coverage": share,
                    "coverage_low": low,
                    "coverage_high": high,
                    "coverage_over_time": inside[..., j][told[..., j]].mean(),
                    "not_observable": float((~told[-1, :, j]).mean()),
                    "stated_sd": float(np.median(course.sd[-1, :, j])),
                }
            )
            parts.append(
                pd.DataFrame(
                    {
                        "parameter": short(parameter),
                        "time_s": motion.times_s[course.at],
                        "coverage": inside[..., j].mean(axis=1),
                        "told": told[..., j].mean(axis=1),
                        "stated_sd": np.median(course.sd[..., j], axis=1),
                        "median_error": np.median(np.abs(course.x - truth)[..., j], axis=1),
                    }
                )
            )
        write_parquet(folder / OVER_TIME, pd.concat(parts, ignore_index=True))
        return rows

    def _freezing(self, experiment: Experiment, motion: RemoteMotion, copies: Copies, folder: Path) -> Rows:
        watch = Watch(Tracker(copies, measured_sd(experiment.link.noise)), self.certain)
        prior = self.prior.around(experiment.local)
        changed_at = int(np.searchsorted(motion.times_s, self.change_s - 1e-9))
        windows, noise = motion.windows(), experiment.link.noise
        moved = {change.name: self._changed(motion, change, copies, changed_at) for change in CHANGES}
        seen: dict[str, list[_Seen]] = {change.name: [] for change in CHANGES}
        for i in track(range(self.watched_seeds), "Watching", unit="runs"):
            seeds = [experiment.seed + 10_000 + i]
            measured = moved["none"].measured(noise, seeds)
            # until the change they are all the same
            before = _watched(watch, watch.start(prior, measured[:, 0]), windows[:changed_at], measured)
            for name, changed in moved.items():
                rest = changed.measured(noise, seeds)[:, changed_at:]
                seen[name].append(before.followed_by(_watched(watch, before.last, windows[changed_at:], rest)))
        rows = [self._freezing_row(change, motion, seen[change.name], changed_at) for change in CHANGES]
        courses = [
            self._course(change, motion, np.array(seen[change.name][0].x), seen[change.name][0].frozen, copies)
            for change in CHANGES
        ]
        write_parquet(folder / WATCHED, pd.concat(courses, ignore_index=True))
        return rows

    @staticmethod
    def _changed(motion: RemoteMotion, change: Change, copies: Copies, changed_at: int) -> RemoteMotion:
        """Return how the object moves if it changes before that update."""
        after = change.applied(motion.true_x)
        states, at = [], np.zeros((1, STATE))
        for k, pushes in enumerate(motion.windows()):
            at = copies.run((after if k >= changed_at else motion.true_x)[None], at, pushes)
            states.append(at[0])
        return replace(motion, states=np.array(states))

    def _freezing_row(self, change: Change, motion: RemoteMotion, seen: list[_Seen], changed_at: int) -> dict[str, Any]:
        unchanged = change.name == "none"
        right = [[k for k in run.alarms if k >= changed_at and not unchanged] for run in seen]
        first_s = [motion.times_s[alarms[0]] - motion.times_s[changed_at - 1] for alarms in right if alarms]
        after = change.applied(motion.true_x)
        return {
            "part": "freezing",
            "what": change.name,
            "runs": len(seen),
            "frozen_before": float(np.mean([run.frozen[changed_at - 1] for run in seen])),
            "set_free": np.nan if unchanged else len(first_s) / len(seen),
            "set_free_median_s": float(np.median(first_s)) if first_s else np.nan,
            "set_free_longest_s": max(first_s, default=np.nan),
            "false_alarms": sum(len(run.alarms) - len(alarms) for run, alarms in zip(seen, right, strict=True)),
            "later_alarms": sum(max(len(alarms) - 1, 0) for alarms in right),
            "frozen_again": float(np.mean([run.frozen[-1] for run in seen])),
            "largest_final_error": max(float(np.abs(run.x[-1] - after).max()) for run in seen),
        }

    @staticmethod
    def _course(
        change: Change, motion: RemoteMotion, x: np.ndarray, frozen: list[bool], copies: Copies
    ) -> pd.DataFrame:
        values = to_values(x, copies.half_size_m)
        columns = {parameter: values[:, j] for j, parameter in enumerate(PARAMETERS)}
        return pd.DataFrame({"change": change.name, "time_s": motion.times_s, "frozen": frozen, **columns})

    def _averages(self, experiment: Experiment, motion: RemoteMotion, copies: Copies) -> Rows:
        measured = motion.measured(experiment.link.noise, [experiment.seed + i for i in range(self.average_seeds)])
        true_kg = float(to_values(motion.true_x, copies.half_size_m)[MASS])
        rules = {
            "linear": Linear(),
            "median of linear": Averaged(Linear(), Average.median),
            "mean of linear": Averaged(Linear(), Average.mean),
        }
        rows: Rows = []
        with progress("Averages", total=len(rules), unit="rules") as advance:
            for name, rule in rules.items():
                error = published(rule, copies, experiment, motion, measured) / true_kg - 1
                rows.append(
                    {
                        "part": "average",
                        "what": name,
                        "runs": self.average_seeds,
                        "final_rmse": float(np.sqrt((error[:, -1] ** 2).mean())),
                        "final_median_error": float(np.median(np.abs(error[:, -1]))),
                        "median_error": float(np.median(np.abs(error))),
                        "largest_error": float(np.abs(error).max()),
                    }
                )
                advance()
        return rows
