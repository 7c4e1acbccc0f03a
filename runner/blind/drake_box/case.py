"""One case of the second world: a scene by Drake that departs from what is believed, its recording, and the answer."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from runner.blind.drake_box.excite import draw_episode, draw_episodes
from runner.blind.drake_box.outside import OUTSIDE
from runner.blind.drake_box.physics import Scene
from runner.blind.drake_box.plants import VOCABULARY, ScenePlant, draw
from runner.blind.drake_box.roughness import FINE, misstated, roughened, simulate_or_none
from runner.blind.drake_engine import drake
from runner.blind.make import RATIOS, AbstractMaker, CasePlan, draw_size, error_ratio, nearest_band
from runner.blind.make.noise import draw_character
from runner.blind.planar_box.case import KINDS
from runner.blind.planar_box.excite import Drive
from runner.blind.planar_box.files import nominal_of, table_of, write_made
from runner.blind.planar_box.physics import PlannedEpisode
from runner.blind.planar_box.plants import TOGETHER_ALIKE, UnplantedCase
from runner.blind.planar_box.reality import Reality, draw_noise, draw_world
from runner.blind.planar_box.reality import simulate_or_none as by_equations
from runner.errors import check_range

APART = 0.5  # noises by which the engine may differ from the equations of motion, in an episode without any effect
REDRAWS = 6  # of an episode that differs by more


@dataclass(frozen=True)
class DrakeBoxMaker(AbstractMaker):
    """Makes boxes that are pushed over a floor in Drake.

    Sizes are drawn evenly in the logarithm of the error ratio, whatever severity was planned: an answer names the
    nearest of the bands that there are.

    Args:
        reality: Shapes and noises; its texture, sizes and mismatches are not used.
        roughness: How far a world is from what its owner believes, besides the effect; 0: not at all, 1: by up to two
            noises through its sizes, one through its floor and one through pushes that come late by up to a sample,
            and with a noise that is stated wrong by up to half.
    """

    reality: Reality = field(default_factory=Reality)
    roughness: float = 1.0

    system = "planar_box_drake"
    vocabulary = VOCABULARY
    outside = tuple(OUTSIDE)
    together_alike = TOGETHER_ALIKE
    attempts = 20
    before = ("mass",)

    def __post_init__(self) -> None:
        check_range("roughness", self.roughness, 0.0, 3.0)

    def check_ready(self) -> None:
        """See `AbstractMaker`."""
        drake("multibody.plant")

    def with_roughness(self, roughness: float) -> DrakeBoxMaker:
        """See `AbstractMaker`."""
        return replace(self, roughness=roughness)

    def settings(self) -> dict[str, Any]:
        """See `AbstractMaker`."""
        return {"reality": asdict(self.reality), "roughness": self.roughness}

    def try_to_make(self, plan: CasePlan, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
        """See `AbstractMaker`."""
        made = _try_case(plan, self, g)
        return None if made is None else write_made(made, folder)


def _try_case(plan: CasePlan, maker: DrakeBoxMaker, g: np.random.Generator) -> tuple[dict, pd.DataFrame, dict] | None:
    reality, roughness = maker.reality, maker.roughness
    believed = draw_world(reality, g)
    rate_hz = float(g.choice([60, 60, 60, 100, 120, 240]))
    drive = Drive(believed, rate_hz, heights=bool(g.random() < reality.heights))
    noise = draw_noise(believed, reality, g)
    sigma = np.array([noise[kind] for kind in KINDS])
    drawn = _reproducible(drive, sigma, g)
    if drawn is None:
        return None
    episodes, nominal_paths, apart = drawn
    coarse = simulate_or_none(Scene(believed), UnplantedCase(believed, episodes, []))
    if coarse is None:
        return None
    case = UnplantedCase(believed, episodes, coarse)
    real, mismatch = roughened(case, roughness, sigma, g)
    plain, plain_fine = simulate_or_none(real, case), simulate_or_none(real, case, FINE)
    if plain is None or plain_fine is None:
        return None

    scene, sizes = real, []
    for name, _ in plan.wanted:
        plant = draw(name, replace(case, world=real.world), g)
        size = draw_size(_excess(plant, real, plain, case, sigma), plant.largest, RATIOS[plan.kind], g)
        if size is None:
            return None
        sizes.append((plant, scene, size))
        scene = plant.edit(scene, size)
    paths = simulate_or_none(scene, case, FINE)
    if paths is None:
        return None
    effects, ratios = [], []
    for plant, before, size in sizes:
        alone = paths if len(sizes) == 1 else simulate_or_none(plant.edit(real, size), case, FINE)
        moved = math.sqrt(1.0 + error_ratio(alone, plain_fine, sigma) ** 2)
        if not 0.9 * RATIOS[plan.kind][0] <= moved < math.inf:
            return None
        effects.append(_told(plan, plant, plant.true(before, size), moved))
        ratios.append(round(moved, 3))
    character = draw_character(reality.coloured, reality.outliers, g)
    measured = [path + character.draw(len(path), sigma, rate_hz, g) for path in paths]
    answer = {
        "effects": effects,
        "error_ratio": round(error_ratio(measured, nominal_paths, sigma), 3),
        "accept": sorted({word for plant, _, _ in sizes for word in plant.accept}) or ["none"],
        "made": {
            "kind": plan.kind,
            "system": maker.system,
            "roughness": roughness,
            "moved": ratios,
            "reserved": [e["true"]["what"] for e in effects if e["true"].get("what") in maker.reserved],
            "mismatch_ratio": round(error_ratio(plain_fine, nominal_paths, sigma), 4),
            "mismatch": mismatch,
            "engine_ratio": round(apart, 4),
            "noise": noise,
            **character.told(),
            "starts": [[round(float(v), 6) for v in e.start] for e in episodes],
        },
    }
    table = table_of(episodes, measured, heights=drive.heights)
    return nominal_of(believed, rate_hz, misstated(noise, roughness, g), reality, g), table, answer


def _reproducible(
    drive: Drive, sigma: np.ndarray, g: np.random.Generator
) -> tuple[list[PlannedEpisode], list[np.ndarray], float] | None:
    """Return episodes in which the engine moves the box as the equations of motion do, its paths, and how far apart.

    Where they differ, the outcome hangs on a hair (which of two ways a pushed box turns away): such an episode is drawn
    anew.
    """
    episodes = draw_episodes(drive, g)
    paths: list[np.ndarray] = []
    expected: list[np.ndarray] = []
    for number, planned in enumerate(episodes):
        episode = planned
        for _ in range(REDRAWS):
            one = UnplantedCase(drive.world, [episode], [])
            path, wanted = simulate_or_none(Scene(drive.world), one, FINE), by_equations(drive.world, [episode])
            if path is not None and wanted is not None and error_ratio(path, wanted, sigma) <= APART:
                break
            episode = draw_episode(
                drive, g, int(g.integers(7)), thrown=False, elapsed_s=planned.elapsed_s, number=number
            )
        else:
            return None
        episodes[number] = episode
        paths += path
        expected += wanted
    elapsed_s = 0.0
    for number, episode in enumerate(episodes):
        episodes[number] = replace(episode, elapsed_s=elapsed_s)
        elapsed_s += episode.duration_s
    return episodes, paths, error_ratio(paths, expected, sigma)


def _excess(
    plant: ScenePlant, real: Scene, plain: list[np.ndarray], case: UnplantedCase, sigma: np.ndarray
) -> Callable[[float], float]:
    return cache(lambda size: error_ratio(simulate_or_none(plant.edit(real, size), case), plain, sigma))


def _told(plan: CasePlan, plant: ScenePlant, true: dict[str, float | str], moved: float) -> dict[str, Any]:
    values = {k: v if isinstance(v, str) else float(v) for k, v in true.items()}
    if plan.kind == "unknown":
        values = {"what": plant.name, **values}
    name = "unknown" if plan.kind == "unknown" else plant.name
    return {"name": name, "severity": nearest_band(moved), "true": values}
