"""One case of a body in space: a world by Drake that departs from what is believed, its recording, and the answer."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from runner.blind.drake_body.excite import KINDS, RATES_HZ, draw_toss, draw_world
from runner.blind.drake_body.files import by_mujoco, mjcf, nominal_of, table_of, write_case
from runner.blind.drake_body.physics import STEP_S, DrakeError, Toss, World, away, lowest_m, simulate_all
from runner.blind.drake_body.physics.poses import moved, turns_of
from runner.blind.drake_body.plants import OUTSIDE, TOGETHER_ALIKE, VOCABULARY, BodyPlant, UnplantedBody, draw
from runner.blind.drake_engine import drake
from runner.blind.make import RATIOS, AbstractMaker, CasePlan, draw_size, error_ratio, nearest_band
from runner.blind.make.noise import draw_character

COARSE_S = 1e-3  # longest step while a size is looked for
APART = 0.5  # noises (rms) by which the engines may differ, from the start of an episode to its end, without any effect
TOUCHING_M, AFTER_S, LEAST_AFTER_S = 5e-4, 0.6, 0.03  # a touch; how long after it is looked, and is left at least
REDRAWS = 12  # of an episode of which less is left


@dataclass(frozen=True)
class Circumstances:
    """How cases differ besides their effect.

    Args:
        coloured, outliers: Shares of those with noise that is slow in part, with one sample in 200 far off.
        noise_unknown: Share of those whose noise is not stated.
        episodes: How many of them; from, to.
        position_m, turn_rad: Standard deviation of the noise; from, to.
    """

    coloured: float = 0.15
    outliers: float = 0.08
    noise_unknown: float = 0.2
    episodes: tuple[int, int] = (12, 16)
    position_m: tuple[float, float] = (1e-3, 3e-3)
    turn_rad: tuple[float, float] = (0.01, 0.03)


@dataclass(frozen=True)
class DrakeBodyMaker(AbstractMaker):
    """Makes cubes, boxes and cylinders that are tossed onto a table in Drake.

    Sizes are drawn evenly in the logarithm of the error ratio, whatever severity was planned: an answer names the
    nearest of the bands that there are.
    """

    circumstances: Circumstances = field(default_factory=Circumstances)

    system = "free_body_drake"
    vocabulary = tuple(VOCABULARY)
    outside = tuple(OUTSIDE)
    together_alike = TOGETHER_ALIKE
    attempts = 8

    def check_ready(self) -> None:
        """See `AbstractMaker`."""
        drake("multibody.plant")

    def settings(self) -> dict[str, Any]:
        """See `AbstractMaker`."""
        return {"circumstances": asdict(self.circumstances)}

    def try_to_make(self, plan: CasePlan, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
        """See `AbstractMaker`."""
        return _try_case(plan, self, folder, g)


@dataclass(frozen=True)
class _Drawn:
    """A case without any effect: tosses, where Drake and where MuJoCo take the body, and the noise, (6,)."""

    world: World
    tosses: Sequence[Toss]
    paths: Sequence[np.ndarray]
    nominal: Sequence[np.ndarray]
    sigma: np.ndarray


def _try_case(plan: CasePlan, maker: DrakeBodyMaker, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
    drawn = _draw(maker.circumstances, g)
    if drawn is None:
        return None
    coarse = _simulated(drawn.world, drawn.tosses, step_s=COARSE_S)
    if coarse is None:
        return None
    case, world, sizes = UnplantedBody(drawn.world, drawn.paths), drawn.world, []
    for name, _ in plan.wanted:
        plant = draw(name, case, g)
        excess = cache(partial(_excess, drawn, plant, coarse))
        size = draw_size(excess, plant.largest, RATIOS[plan.kind], g)
        if size is None:
            return None
        sizes.append((plant, world, size))
        world = plant.edit(world, size)
    paths = _simulated(world, drawn.tosses)
    if paths is None:
        return None
    effects, ratios = [], []
    for plant, before, size in sizes:
        alone = paths if len(sizes) == 1 else _simulated(plant.edit(drawn.world, size), drawn.tosses)
        if alone is None:
            return None
        shown = math.hypot(1.0, _ratio(alone, drawn.paths, drawn.sigma))
        if shown < 0.9 * RATIOS[plan.kind][0]:
            return None
        effects.append(_told(plan, plant, plant.true(before, size), shown))
        ratios.append(round(shown, 3))
    c, rate_hz = maker.circumstances, drawn.tosses[0].rate_hz
    character = draw_character(c.coloured, c.outliers, g)
    measured = [moved(path, character.draw(len(path), drawn.sigma, rate_hz, g)) for path in paths]
    noise = dict(zip(("x", "y", "z", "quat"), drawn.sigma[[0, 1, 2, 3]].tolist(), strict=True))
    stated: dict[str, float | None] | None = None if g.random() < c.noise_unknown else {**noise}
    write_case(folder, drawn.world, nominal_of(drawn.world, stated), table_of(drawn.tosses, measured))
    return {
        "effects": effects,
        "error_ratio": round(_ratio(measured, drawn.nominal, drawn.sigma), 3),
        "accept": sorted({name for e in effects for name in e["accept"]}) or ["none"],
        "made": {
            "kind": plan.kind,
            "system": maker.system,
            "body": drawn.world.shape.value,
            "moved": ratios,
            "reserved": [e["true"]["what"] for e in effects if e["true"].get("what") in maker.reserved],
            "engine_ratio": round(_ratio(drawn.paths, drawn.nominal, drawn.sigma), 4),
            "noise": noise,
            **character.told(),
        },
    }


def _draw(c: Circumstances, g: np.random.Generator) -> _Drawn | None:
    """Draw a world and tosses after which both engines take it to the same places; none where they hardly do."""
    world, rate_hz = draw_world(g), float(g.choice(RATES_HZ))
    position, turn = (float(np.exp(g.uniform(*np.log(span)))) for span in (c.position_m, c.turn_rad))
    sigma = np.array([float(f"{position:.2g}")] * 3 + [float(f"{turn:.2g}")] * 3)
    count = int(g.integers(c.episodes[0], c.episodes[1] + 1))
    tosses: list[Toss] = []
    paths: list[np.ndarray] = []
    nominal: list[np.ndarray] = []
    # both kinds of episodes among those that are held out
    for number in range(count):
        found = _agreeing(world, KINDS[number % len(KINDS)], rate_hz, sigma, g)
        if found is None:
            return None
        tosses.append(found[0])
        paths.append(found[1])
        nominal.append(found[2])
    return _Drawn(world, tosses, paths, nominal, sigma)


def _agreeing(
    world: World, kind: str, rate_hz: float, sigma: np.ndarray, g: np.random.Generator
) -> tuple[Toss, np.ndarray, np.ndarray] | None:
    """Draw a toss, cut where the engines part: what they make of an impact is not what the case is about.

    After several impacts the outcome hangs on a hair, and after the first on how a contact is modelled.
    """
    for _ in range(REDRAWS):
        toss = draw_toss(world, kind, rate_hz, g)
        (nominal,) = by_mujoco(mjcf(world), [toss])
        heights = lowest_m(world, turns_of(nominal).as_matrix(), nominal[:, 2])
        touch = int(np.argmax(heights < TOUCHING_M))
        if kind != "slid":
            toss = replace(toss, samples=min(toss.samples, touch + round(AFTER_S * rate_hz)))
        paths = _simulated(world, [toss])
        if paths is None:
            continue
        (off,) = away(paths, [nominal[: toss.samples]])
        square = np.cumsum(np.mean((off / sigma) ** 2, axis=1)) / np.arange(1, len(off) + 1)
        samples = int(np.argmax(square > APART**2)) if np.any(square > APART**2) else len(off)
        if samples >= touch + max(round(LEAST_AFTER_S * rate_hz), 4) and samples >= 0.15 * rate_hz:
            return replace(toss, samples=samples), paths[0][:samples], nominal[:samples]
    return None


def _simulated(world: World, tosses: Sequence[Toss], step_s: float = STEP_S) -> list[np.ndarray] | None:
    try:
        return simulate_all(world, tosses, step_s=step_s)
    except DrakeError:
        return None


def _excess(drawn: _Drawn, plant: BodyPlant, coarse: Sequence[np.ndarray], size: float) -> float:
    """Return how far an effect moves the body, in noises, by long steps."""
    paths = _simulated(plant.edit(drawn.world, size), drawn.tosses, step_s=COARSE_S)
    return math.inf if paths is None else _ratio(paths, coarse, drawn.sigma)


def _ratio(paths: Sequence[np.ndarray], others: Sequence[np.ndarray], sigma: np.ndarray) -> float:
    off = away(paths, others)
    return error_ratio(off, [np.zeros_like(o) for o in off], sigma)


def _told(plan: CasePlan, plant: BodyPlant, true: dict[str, float], shown: float) -> dict[str, Any]:
    """Return an effect as the answer tells it."""
    severity = nearest_band(shown)
    values = {key: float(value) for key, value in true.items()}
    if plan.kind == "unknown":
        return {"name": "unknown", "severity": severity, "true": {"what": plant.name, **values}, "accept": ["unknown"]}
    target = {} if plant.target is None else {"target": plant.target}
    return {"name": plant.name, **target, "severity": severity, "true": values, "accept": [plant.full]}
