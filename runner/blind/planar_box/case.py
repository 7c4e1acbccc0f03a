"""One case: a world that departs from what is believed, its recording, and the answer."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from runner.blind.make import BANDS, PAIR_BANDS, AbstractMaker, CasePlan, error_ratio, size_for
from runner.blind.make.noise import draw_character
from runner.blind.planar_box.excite import Drive, draw_episodes
from runner.blind.planar_box.files import nominal_of, table_of, write_made
from runner.blind.planar_box.physics import World
from runner.blind.planar_box.plants import OUTSIDE, TOGETHER_ALIKE, VOCABULARY, Plant, UnplantedCase, draw
from runner.blind.planar_box.reality import COARSE, Reality, draw_noise, draw_world, mismatched, simulate_or_none

KINDS = ("position", "position", "yaw", "velocity", "velocity", "rate")  # of the six channels


@dataclass(frozen=True)
class PlanarBoxMaker(AbstractMaker):
    """Makes boxes that are pushed over a floor; `reality` says how they depart from the textbook."""

    reality: Reality = field(default_factory=Reality)

    system = "planar_box"
    vocabulary = tuple(VOCABULARY)
    outside = tuple(OUTSIDE)
    together_alike = TOGETHER_ALIKE
    before = ("mass",)  # its inertia comes before one of its own

    def settings(self) -> dict[str, Any]:
        """See `AbstractMaker`."""
        return {"reality": asdict(self.reality)}

    def try_to_make(self, plan: CasePlan, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
        """See `AbstractMaker`; where a severity can't be reached, the next lower one is tried."""
        made = _try_case(plan, self.reality, g)
        return None if made is None else write_made(made, folder)


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
        lowest = "moderate" if plan.kind != "single" else "subtle"
        sized = size_for(partial(_excess, plant, real, case, sigma), plant.largest, severity, bands, g, lowest=lowest)
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
    character = draw_character(reality.coloured, reality.outliers, g)
    measured = [path + character.draw(len(path), sigma, rate_hz, g) for path in paths]
    answer = {
        "effects": effects,
        "error_ratio": round(error_ratio(measured, nominal_paths, sigma), 3),
        "accept": sorted(accept) or ["none"],
        "made": {
            "kind": plan.kind,
            "mismatch_ratio": round(error_ratio(simulate_or_none(real, episodes), nominal_paths, sigma), 4),
            "mismatch": mismatch,
            "noise": noise,
            **character.told(),
            "starts": [[round(float(v), 6) for v in e.start] for e in episodes],
        },
    }
    table = table_of(episodes, measured, heights=drive.heights)
    return nominal_of(believed, rate_hz, noise, reality, g), table, answer


def _excess(plant: Plant, real: World, case: UnplantedCase, sigma: np.ndarray, size: float) -> float:
    return error_ratio(simulate_or_none(plant.edit(real, size), case.episodes, **COARSE), case.paths, sigma)


def _within_bands(excess: float, effects: list[dict]) -> bool:
    # sizes were found with coarse points; a single effect must keep its severity with the fine ones
    if len(effects) != 1:
        return True
    low, high = BANDS[effects[0]["severity"]]
    return 0.95 * low <= math.sqrt(1.0 + excess * excess) <= 1.05 * high
