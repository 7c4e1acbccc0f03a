"""Calibrate an object: choose pushes by what they will tell, until its parameters are known well enough.

The object is simulated (`remote`), and measured with noise (`link.noise`); what is believed of it beforehand is
`start`, with the uncertainty `prior`. Each push is chosen by its expected information within `limits`. The results
folder holds the calibrated model (`model.xml`, MJCF, and `calibrated.yaml` with every parameter, its 95 % interval, and
whether the data have told of it), the pushes as `pushes.csv`, which `runner forces=csv forces.path=...` plays again,
the estimate after each message (`track.parquet`), `run.rrd` with the pushes played again, and `summary.parquet`.

    runner calibrate remote.mass_kg=4 'remote.com_m=[0.08,-0.05,0]'
    runner calibrate target=0.005 limits.force_n=20 limits.workspace_m=0.5
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.table import Table

from runner.commands import Command, Job
from runner.commands.run import write_versions
from runner.errors import ConfigError, check_range
from runner.estimation.belief import observable
from runner.estimation.calibration import Calibrated, LimitsConfig, Planner, Thing, calibrate, write_pushes
from runner.estimation.copies import LABELS, Copies, errors, from_values, to_values
from runner.estimation.data import measured_sd
from runner.estimation.joint import Joint, PriorConfig, write_view
from runner.estimation.tracker import Tracker
from runner.estimation.watch import INTERVAL
from runner.physics.forces import CsvForces
from runner.physics.scene import BodyConfig, SceneConfig, box_inertia, build
from runner.progress import progress
from runner.storage.writing import write_parquet, write_text, write_yaml
from runner.teleop.experiment import Experiment, RemoteConfig, StartConfig
from runner.teleop.link import LinkConfig, update_steps
from runner.teleop.parameters import COM_X, COM_Y, FRICTION, MASS, PARAMETERS, YAW_INERTIA, values_of
from runner.teleop.tables import write_summary

MODEL, VALUES, PUSHES, TRACK = "model.xml", "calibrated.yaml", "pushes.csv", "track.parquet"


@dataclass(frozen=True)
class CalibrateConfig:
    """What is calibrated (`remote`), how it is pushed (`limits`), and what is known of it beforehand (`prior`).

    `target` is the half width of all 95 % intervals at which it stops: as share of mass, yaw inertia and friction, and
    of the half size for the CoM. It stops after `longest_s` in any case.
    """

    seed: int
    scene: SceneConfig
    remote: RemoteConfig
    start: StartConfig
    link: LinkConfig
    target: float = 0.01
    longest_s: float = 30.0
    limits: LimitsConfig = field(default_factory=LimitsConfig)
    prior: PriorConfig = field(default_factory=PriorConfig)

    def __post_init__(self) -> None:
        check_range("seed", self.seed, 0, 2**63 - 1)
        check_range("target", self.target, 0.0, 1.0, lower_open=True)
        check_range("longest_s", self.longest_s, 0.0, 1e4, unit="s", lower_open=True)
        for name, effect in self.remote.effects.items():
            raise ConfigError(f"remote.effects.{name}: '{effect.name}' can't be calibrated; runner diagnose finds it.")


def main(config: CalibrateConfig, job: Job) -> int | None:
    """Calibrate, write and print; exit code 1 where the asked certainty was not reached."""
    write_versions(job.results)
    remote, local = config.remote.body, config.start.body(config.remote)
    copies = Copies(config.scene, local)
    noise = measured_sd(config.link.noise)
    tracker = Tracker(copies, noise)
    period = int(update_steps(config.link, config.scene.timestep_s, 100_000)[0])
    true_x = from_values(np.array(list(values_of(remote).values())), remote.half_size_m)
    thing = Thing(copies, true_x, noise, np.random.default_rng([config.seed, 2]))
    planner = Planner(tracker, config.limits, period, config.target)
    prior = config.prior.around(local)
    with progress("Calibrating", total=None):
        done = calibrate(
            thing, tracker, prior, lambda belief, steps: planner.next(belief, np.zeros(2)),
            period=period, target=config.target, longest_s=config.longest_s,
        )  # fmt: skip
    table = _table(done, remote, true_x, prior.sd)
    _write(job.results, config, done, table, period)
    row = {**job.about, "status": "done", "seed": config.seed, "reached": done.reached, "time_s": done.time_s}
    row |= {"pushes": len(done.pushes), "farthest_m": done.reach_m}
    for name, one in table.iterrows():
        row |= {f"{name}_{key}": one[key] for key in ("value", "half_width", "error")}
    write_summary([row], job.results)
    _print(config, done, table, job.results)
    return None if done.reached else 1


def _table(done: Calibrated, remote: BodyConfig, true_x: np.ndarray, prior_sd: np.ndarray) -> Any:
    """Return a row for each parameter; half widths and errors are shares, of the half size for the CoM."""
    x, sd = done.belief.x[0], done.belief.sd[0]
    return pd.DataFrame(
        {
            "label": LABELS,
            "value": to_values(x, remote.half_size_m),
            "low": to_values(x - INTERVAL * sd, remote.half_size_m),
            "high": to_values(x + INTERVAL * sd, remote.half_size_m),
            "true": to_values(true_x, remote.half_size_m),
            "half_width": INTERVAL * sd,
            "error": errors(x, true_x),
            "observed": observable(sd, prior_sd),
        },
        index=pd.Index(PARAMETERS),
    )


def calibrated_body(table: Any, start: BodyConfig) -> BodyConfig:
    """Return the calibrated body. Moments about level axes don't show in the plane: those of a box of this mass."""
    value = table["value"]
    yaw = float(value[YAW_INERTIA])
    ixx, iyy, _ = box_inertia(float(value[MASS]), start.half_size_m)
    stretch = max(1.0, yaw / (ixx + iyy))  # no body has a moment larger than the sum of the other two
    return BodyConfig(
        mass_kg=float(value[MASS]),
        friction=float(value[FRICTION]),
        half_size_m=start.half_size_m,
        com_m=(float(value[COM_X]), float(value[COM_Y]), start.com_m[2]),
        inertia_kg_m2=(max(ixx * stretch, yaw - iyy), iyy * stretch, yaw),
    )


def _write(folder: Path, config: CalibrateConfig, done: Calibrated, table: Any, period: int) -> None:
    body = calibrated_body(table, config.start.body(config.remote))
    write_text(folder / MODEL, build(config.scene, {"object": body}).to_xml_string())
    content = {
        "model": MODEL,
        "certain": done.reached,
        "time_s": round(done.time_s, 6),
        "pushes": len(done.pushes),
        "parameters": {
            str(name): {
                "value": float(one["value"]),
                "interval_95": [float(one["low"]), float(one["high"])],
                "observed": bool(one["observed"]),
            }
            for name, one in table.iterrows()
        },
    }
    write_yaml(folder / VALUES, content)
    write_pushes(folder / PUSHES, done, config.scene.timestep_s)
    shown = Experiment(
        seed=config.seed,
        scene=config.scene,
        forces=CsvForces(str(folder / PUSHES)),
        remote=config.remote,
        start=config.start,
        link=config.link,
        estimator={"joint": Joint(config.prior, config.link.noise)},
    )
    write_view(shown, folder, dict(shown.estimator))
    track = pd.DataFrame(done.track, columns=[*PARAMETERS, *(f"{name}_sd" for name in PARAMETERS)])
    values = to_values(done.track[:, : len(PARAMETERS)], config.remote.half_size_m)
    track[list(PARAMETERS)] = values
    track.insert(0, "time_s", (np.arange(len(track)) + 1) * period * config.scene.timestep_s)
    write_parquet(folder / TRACK, track)


def _print(config: CalibrateConfig, done: Calibrated, table: Any, folder: Path) -> None:
    state = "certain" if done.reached else "not certain yet"
    shown = Table(title=f"{state} after {len(done.pushes)} pushes, {done.time_s:.2f} s")
    for column in ("", "calibrated", "95 % interval", "true", "error", "asked"):
        shown.add_column(column, justify="left" if not column else "right")
    for _, one in table.iterrows():
        told = f"{one['low']:.5g} .. {one['high']:.5g}" if one["observed"] else "not yet observable"
        shown.add_row(
            str(one["label"]), f"{one['value']:.6g}", told, f"{one['true']:.6g}", f"{100 * one['error']:+.3f} %",
            f"{100 * config.target:g} %",
        )  # fmt: skip
    console = Console()
    console.print(shown)
    console.print(f"Calibrated model: {folder / MODEL}, {folder / VALUES}", highlight=False, soft_wrap=True)


COMMAND = Command(config=CalibrateConfig, main=main, keeps="calibrate", again="Begin again with")
