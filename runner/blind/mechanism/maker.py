"""Makes cases of mechanisms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from runner.blind.make import BANDS, PAIR_BANDS, AbstractMaker, CasePlan, error_ratio, size_for
from runner.blind.make.noise import draw_character
from runner.blind.mechanism.case import SYSTEMS, Unplanted
from runner.blind.mechanism.draw import DRAWN, Needs
from runner.blind.mechanism.excite import RATES_HZ, Clock, draw_episodes
from runner.blind.mechanism.files import nominal_of, table_of, write_case
from runner.blind.mechanism.physics import COARSE_S, World, simulate_or_none
from runner.blind.mechanism.plants import TOGETHER_ALIKE, Plant, kinds_of


@dataclass(frozen=True)
class Circumstances:
    """How cases differ besides their effect: shares of them, each may be 0, and ranges.

    Args:
        coloured: With noise that is slow in part.
        outliers: With one sample in 200 far off.
        noise_unknown, noise_partly: Whose noise is not stated, or only of some channels.
        uneven: With a clock that is uneven, and samples that are missing.
        no_velocities: Without measured velocities.
        some_velocities: Whose velocities are missing in many samples.
        held: Whose episodes begin at rest, from being held.
        episodes, seconds: How many of them, and how long they are; from, to.
    """

    coloured: float = 0.15
    outliers: float = 0.08
    noise_unknown: float = 0.2
    noise_partly: float = 0.15
    uneven: float = 0.25
    no_velocities: float = 0.25
    some_velocities: float = 0.15
    held: float = 0.4
    episodes: tuple[int, int] = (6, 8)
    seconds: tuple[float, float] = (3.0, 6.0)


@dataclass(frozen=True)
class MechanismMaker(AbstractMaker):
    """Makes pendulums, arms or slides; what their owner believes is exact but for the effect."""

    name: str
    circumstances: Circumstances = field(default_factory=Circumstances)

    together_alike = TOGETHER_ALIKE
    before = ("mass", "actuator_gain")

    @property
    def system(self) -> str:
        """See `AbstractMaker`."""
        return self.name

    @property
    def vocabulary(self) -> Sequence[str]:
        """See `AbstractMaker`."""
        return tuple(kinds_of(self.system)[0])

    @property
    def outside(self) -> Sequence[str]:
        """See `AbstractMaker`."""
        return tuple(kinds_of(self.system)[1])

    def settings(self) -> dict[str, Any]:
        """See `AbstractMaker`."""
        return {"circumstances": asdict(self.circumstances)}

    def try_to_make(self, plan: CasePlan, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
        """See `AbstractMaker`; where a severity can't be reached, the next lower one is tried."""
        return _try_case(self, plan, folder, g)


@dataclass(frozen=True)
class _Drawn:
    """A case without any effect, its noise, and which rows of which columns are not measured."""

    case: Unplanted
    sigma: np.ndarray  # of all columns, (2 count,)
    clock: Clock
    lacking: float  # share of the velocities


def _draw(maker: MechanismMaker, needs: Needs, g: np.random.Generator) -> _Drawn | None:
    c = maker.circumstances
    world = replace(DRAWN[maker.system](needs, g), seed=int(g.integers(2**31)))
    uneven = g.random() < c.uneven
    clock = Clock(float(g.choice(RATES_HZ)), *((float(g.uniform(0.1, 0.6)), 0.02) if uneven else (0.0, 0.0)))
    held = bool(g.random() < c.held)
    episodes = draw_episodes(world, clock, g, held=held, counts=c.episodes, seconds=c.seconds)
    drawn = g.random()
    without = not needs.velocities and drawn < c.no_velocities
    lacking = float(g.uniform(0.3, 0.7)) if without or drawn < c.no_velocities + c.some_velocities else 0.0
    lacking = 0.0 if without or needs.velocities else lacking
    paths = simulate_or_none(world, episodes)
    if paths is None:
        return None
    case = Unplanted(SYSTEMS[maker.system], world, episodes, paths, (True, not without) * len(world.joints))
    sigma = []
    for i in range(case.count):
        position = case.reach(i) * float(np.exp(g.uniform(math.log(5e-4), math.log(5e-3))))
        velocity = position / case.reach(i) * case.speed(i) * float(g.uniform(2.0, 6.0))
        sigma += [float(f"{position:.2g}"), float(f"{velocity:.2g}")]
    return _Drawn(case, np.array(sigma), clock, lacking)


def _excess(drawn: _Drawn, edited: World, coarse: Sequence[np.ndarray] | None) -> float:
    """Return how far a world's readings are from those of the believed one, in noises; of what is measured."""
    kept = np.array(drawn.case.measured)
    paths = None if coarse is None else simulate_or_none(edited, drawn.case.episodes, step_s=COARSE_S)
    if paths is None or coarse is None:
        return math.inf
    return error_ratio([p[:, kept] for p in paths], [p[:, kept] for p in coarse], drawn.sigma[kept])


def _sized(drawn: _Drawn, coarse: Sequence[np.ndarray], plant: Plant, size: float) -> float:
    return _excess(drawn, plant.edit(drawn.case.world, size), coarse)


def _try_case(maker: MechanismMaker, plan: CasePlan, folder: Path, g: np.random.Generator) -> dict[str, Any] | None:
    with_word, without = kinds_of(maker.system)
    kinds = {name: {**with_word, **without}[name] for name, _ in plan.wanted}
    needs = Needs()
    for kind in kinds.values():
        needs |= kind.needs
    drawn = _draw(maker, needs, g)
    coarse = None if drawn is None else simulate_or_none(drawn.case.world, drawn.case.episodes, step_s=COARSE_S)
    if drawn is None or coarse is None:
        return None
    world, effects = drawn.case.world, []
    for name, severity in plan.wanted:
        plant = kinds[name].draw(drawn.case, g)
        if plant is None:
            return None
        lowest = "subtle" if plan.kind == "single" else "moderate"
        bands = PAIR_BANDS if plan.kind == "pair" else BANDS
        sized = size_for(partial(_sized, drawn, coarse, plant), plant.largest, severity, bands, g, lowest=lowest)
        if sized is None:
            return None
        effects.append(_told(plan, plant, world, *sized))
        world = plant.edit(world, sized[0])
    return _recorded(maker, plan, drawn, world, effects, folder, g)


def _told(plan: CasePlan, plant: Plant, world: World, size: float, severity: str) -> dict[str, Any]:
    """Return an effect as the answer tells it."""
    true = {key: float(value) for key, value in plant.true(world, size).items()}
    if plan.kind == "unknown":
        return {"name": "unknown", "severity": severity, "true": {"what": plant.name, **true}, "accept": ["unknown"]}
    target = {} if plant.target is None else {"target": plant.target}
    return {"name": plant.name, **target, "severity": severity, "true": true, "accept": plant.accept}


def _recorded(
    maker: MechanismMaker,
    plan: CasePlan,
    drawn: _Drawn,
    world: World,
    effects: list[dict[str, Any]],
    folder: Path,
    g: np.random.Generator,
) -> dict[str, Any] | None:
    """Simulate, measure and write a case; return its answer, None where it does not keep its severity."""
    case, kept = drawn.case, np.array(drawn.case.measured)
    sigma, c = drawn.sigma[kept], maker.circumstances
    paths = simulate_or_none(world, case.episodes)
    if paths is None:
        return None
    true, believed = ([p[:, kept] for p in some] for some in (paths, case.paths))
    excess = error_ratio(true, believed, sigma)
    if len(effects) == 1:
        # sizes were found with long steps; a single effect must keep its severity with the short ones
        low, high = BANDS[effects[0]["severity"]]
        if not 0.95 * low <= math.hypot(1.0, excess) <= 1.05 * high:
            return None
    character = draw_character(c.coloured, c.outliers, g)
    measured = [p + character.draw(len(p), sigma, drawn.clock.rate_hz, g) for p in true]
    if drawn.lacking:
        rates = np.array([False, True] * case.count)[kept]
        for values in measured:
            values[(g.random(values.shape) < drawn.lacking) & rates] = np.nan
    noise = dict(zip(case.channels, sigma.tolist(), strict=True))
    write_case(folder, case, nominal_of(case, _stated(noise, c, g)), table_of(case, measured))
    return {
        "effects": effects,
        "error_ratio": round(error_ratio(measured, believed, sigma), 3),
        "accept": sorted({name for e in effects for name in e["accept"]}) or ["none"],
        "made": {
            "kind": plan.kind,
            "system": maker.system,
            "reserved": [e["true"]["what"] for e in effects if e["true"].get("what") in maker.reserved],
            "noise": noise,
            **character.told(),
            "uneven_clock": drawn.clock.jitter,
            "velocities_lacking": 1.0 if len(sigma) == case.count else round(drawn.lacking, 3),
            "starts": [[round(float(v), 6) for v in e.start] for e in case.episodes],
        },
    }


def _stated(noise: dict[str, float], c: Circumstances, g: np.random.Generator) -> dict[str, float | None] | None:
    """Return the noise as the owner states it."""
    drawn = g.random()
    if drawn < c.noise_unknown:
        return None
    if drawn < c.noise_unknown + c.noise_partly:
        hidden = g.choice(list(noise), size=int(g.integers(1, len(noise) + 1)), replace=False)
        return {name: None if name in hidden else value for name, value in noise.items()}
    return dict(noise)
