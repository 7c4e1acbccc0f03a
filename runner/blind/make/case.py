"""One case: a world that departs from what is believed, its recording, and the answer."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from runner.blind.excite import Drive, draw_episodes
from runner.blind.make.files import nominal_of, table_of
from runner.blind.make.plan import BANDS, PAIR_BANDS, CasePlan
from runner.blind.make.reality import Reality, draw_noise, draw_world, mismatched, noise_of
from runner.blind.make.size import COARSE, error_ratio, simulate_or_none, size_for
from runner.blind.plants import UnplantedCase, draw
from runner.errors import ConfigError
from runner.storage.writing import write_parquet, write_yaml

KINDS = ("position", "position", "yaw", "velocity", "velocity", "rate")  # of the six channels
ATTEMPTS = 40


def make_case(plan: CasePlan, reality: Reality, folder: Path) -> tuple[str, dict]:
    """Write one case into its folder and return its name and its answer.

    Where a severity can't be reached with a sensible size, the next lower one is tried, then everything is drawn anew.
    """
    generator = np.random.default_rng(plan.seed)
    for _ in range(ATTEMPTS):
        made = _try_case(plan, reality, generator)
        if made is not None:
            nominal, table, answer = made
            folder.mkdir(parents=True, exist_ok=True)
            write_yaml(folder / "nominal.yaml", nominal)
            write_parquet(folder / "recording.parquet", table)
            return folder.name, answer
    raise ConfigError(f"blind.effect: no sensible size of {plan.wanted} reaches its severity in {ATTEMPTS} tries.")


def _try_case(plan: CasePlan, reality: Reality, g: np.random.Generator) -> tuple[dict, pd.DataFrame, dict] | None:
    believed = draw_world(reality, g)
    rate_hz = float(g.choice([60, 60, 60, 100, 120, 240, 240]))
    drive = Drive(believed, rate_hz, heights=bool(g.random() < reality.heights))
    episodes = draw_episodes(drive, g)
    noise = draw_noise(believed, reality, g)
    sigma = np.array([noise[kind] for kind in KINDS])
    coarse, nominal_paths = simulate_or_none(believed, episodes, **COARSE), simulate_or_none(believed, episodes)
    if coarse is None or nominal_paths is None:
        return None
    case = UnplantedCase(believed, episodes, coarse)
    real, mismatch = mismatched(case, reality, sigma, g)

    world, effects, accept = real, [], set()
    for name, severity in plan.wanted:
        plant = draw(name, replace(case, world=real), g)
        bands = PAIR_BANDS if plan.kind == "pair" else BANDS
        sized = size_for(
            plant, severity, bands, real, case, sigma, g, lowest="moderate" if plan.kind != "single" else "subtle"
        )
        if sized is None:
            return None
        size, reached = sized
        true = {k: v if isinstance(v, str) else float(v) for k, v in plant.true(world, size).items()}
        if plan.kind == "unknown":
            effects.append({"name": "unknown", "severity": reached, "true": {"what": name, **true}})
        else:
            effects.append({"name": name, "severity": reached, "true": true})
        world = plant.edit(world, size)
        accept |= set(plant.accept)
    paths = simulate_or_none(world, episodes)
    if paths is None or not _within_bands(error_ratio(paths, nominal_paths, sigma), effects):
        return None
    slow_share = float(g.uniform(0.4, 1.0)) if g.random() < reality.coloured else 0.0
    slow_s = float(np.exp(g.uniform(math.log(0.02), math.log(0.12))))
    colour = slow_share, math.exp(-1.0 / (slow_s * rate_hz))
    outliers = 0.005 if g.random() < reality.outliers else 0.0
    measured = [path + noise_of(len(path), sigma, colour, outliers, g) for path in paths]
    difference = np.concatenate([(m - p) / sigma for m, p in zip(measured, nominal_paths, strict=True)])
    answer = {
        "effects": effects,
        "error_ratio": round(float(np.sqrt(np.mean(difference**2))), 3),
        "accept": sorted(accept) or ["none"],
        "made": {
            "kind": plan.kind,
            "mismatch_ratio": round(error_ratio(simulate_or_none(real, episodes), nominal_paths, sigma), 4),
            "mismatch": mismatch,
            "noise": noise,
            "noise_slow_share": round(slow_share, 3),
            "noise_slow_s": round(slow_s, 4),
            "outlier_share": outliers,
            "starts": [[round(float(v), 6) for v in e.start] for e in episodes],
        },
    }
    table = table_of(episodes, measured, heights=drive.heights)
    return nominal_of(believed, rate_hz, noise, reality, g), table, answer


def _within_bands(excess: float, effects: list[dict]) -> bool:
    # sizes were found with coarse points; a single effect must keep its severity with the fine ones
    if len(effects) != 1:
        return True
    low, high = BANDS[effects[0]["severity"]]
    return 0.95 * low <= math.sqrt(1.0 + excess * excess) <= 1.05 * high
