"""The study: fits without noise and with, and what the fitted box does under pushes on the floor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from dm_control import mjcf

from runner.config import registered
from runner.errors import ConfigError, check_range
from runner.estimation.space.inertial import NAMES, Inertial, inertial_in
from runner.physics.scene import BodyConfig, Dof, FloorContact, build
from runner.progress import track
from runner.studies.base import AbstractStudy, Rows
from runner.studies.compound.fit import InertialFit, fit
from runner.studies.compound.pokes import (
    HUNG,
    STANDING,
    Part,
    Poke,
    PokeSimulator,
    compound_mjcf,
    differences,
    with_noise,
)
from runner.studies.compound.rrd import write_rrd
from runner.teleop.experiment import REMOTE, Experiment
from runner.teleop.link import NoiseConfig

NOISE = NoiseConfig(position_m=5e-4, angle_rad=1e-3, velocity_m_s=5e-3, rate_rad_s=1e-2)


@registered("study")
@dataclass(frozen=True)
class Compound(AbstractStudy):
    """Fit one box to a compound object, without noise and with, and test it with pushes on the floor.

    Attributes:
        parts: What the object is made of; all must lie within the remote's `half_size_m`.
        seeds: Fits with noise.
        duration_s: Of an episode.
    """

    parts: dict[str, Part]
    seeds: int = 3
    duration_s: float = 1.0

    def __post_init__(self) -> None:
        if not self.parts:
            raise ConfigError("parts: at least one is needed.")
        check_range("seeds", self.seeds, 0, 10_000)
        check_range("duration_s", self.duration_s, 0.1, 100.0, unit="s")

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        scene = replace(experiment.scene, dof=Dof.free, contact=FloorContact.corners)
        half = np.array(experiment.remote.half_size_m)
        for name, part in self.parts.items():
            if (np.abs(part.centre_m) + part.half_size_m > half * (1 + 1e-9)).any():
                raise ConfigError(f"study.parts.{name}: reaches out of the object, whose half size is {half} m.")
        friction = experiment.remote.friction
        box = BodyConfig(experiment.start.mass_kg, friction, experiment.remote.half_size_m)

        def episodes(root: mjcf.RootElement, pokes: Sequence[Poke]) -> PokeSimulator:
            return PokeSimulator(
                scene, root, pokes, duration_s=self.duration_s, lead_s=0.0, rate_hz=experiment.link.rate_hz
            )

        def compound() -> mjcf.RootElement:
            return compound_mjcf(scene, friction, experiment.remote.half_size_m, list(self.parts.values()))

        remote = episodes(compound(), HUNG)
        true = inertial_in(remote.model, remote.body_id)
        local = episodes(build(scene, {REMOTE: box}), HUNG)
        start = Inertial(box.mass_kg, np.array(experiment.start.com_m or (0.0, 0.0, 0.0)), np.diag(box.inertia))
        motion = remote.run([true])[0]
        noise = experiment.link.noise or NOISE
        out: Rows = []
        for seed in track(range(self.seeds + 1), "Fitting", unit="fits"):
            measured = motion
            if seed:
                measured = with_noise(motion, noise, np.random.default_rng([experiment.seed, seed]))
            found = fit(local, measured, noise, start, half)
            out += _parameter_rows(seed, true, start, found, half)
            if seed == min(1, self.seeds):
                write_rrd(
                    folder / "run.rrd", list(self.parts.values()), half, motion, experiment.link.rate_hz, true, found
                )
            if seed in (0, 1):
                standing = episodes(build(scene, {REMOTE: box}), list(STANDING.values()))
                truth = episodes(compound(), list(STANDING.values())).run([true])[0]
                out += _test_rows(seed, truth, standing.run([start, found.body]))
        return out


def _parameter_rows(seed: int, true: Inertial, start: Inertial, found: InertialFit, half_size_m: np.ndarray) -> Rows:
    size = np.trace(true.inertia_kg_m2) / 3
    scale = np.concatenate([[true.mass_kg], half_size_m, np.full(6, size)])
    error = found.body.values - true.values
    squared = float(error @ np.linalg.solve(found.covariance, error))
    table = zip(
        NAMES, true.values, start.values, found.body.values, found.covariance.diagonal() ** 0.5, scale, strict=True
    )
    return [
        {
            "noise": bool(seed),
            "seed": seed,
            "parameter": name,
            "true": float(truth),
            "start": float(begin),
            "estimate": float(value),
            "se": float(se) if seed else float("nan"),
            "error": float((value - truth) / unit),
            "mahalanobis2": squared if seed else float("nan"),
        }
        for name, truth, begin, value, se, unit in table
    ]


def _test_rows(seed: int, truth: np.ndarray, both: np.ndarray) -> Rows:
    """Return how far the believed box and the fitted box are from the object, under pushes on the floor."""
    up = 1 - 2 * (truth[..., 4] ** 2 + truth[..., 5] ** 2)
    tilt = np.degrees(np.arccos(np.clip(up, -1, 1))).max(axis=1)
    behind = np.linalg.norm(both[..., :3] - truth[..., :3], axis=-1).max(axis=-1)
    turned = np.degrees(np.linalg.norm(differences(both, truth)[..., 3:6], axis=-1)).max(axis=-1)
    return [
        {
            "noise": bool(seed),
            "seed": seed,
            "test": name,
            "moved_m": float(np.linalg.norm(truth[k, -1, :2] - truth[k, 0, :2])),
            "tilt_deg": float(tilt[k]),
            "start_off_m": float(behind[0, k]),
            "fitted_off_m": float(behind[1, k]),
            "start_off_deg": float(turned[0, k]),
            "fitted_off_deg": float(turned[1, k]),
        }
        for k, name in enumerate(STANDING)
    ]
