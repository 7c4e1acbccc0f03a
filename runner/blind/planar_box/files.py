"""What a case says to whoever diagnoses it: the recording as a table, and what the owner believes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from runner.blind.planar_box.physics import PlannedEpisode, World
from runner.blind.planar_box.reality import Reality
from runner.storage.writing import write_parquet, write_yaml

COLUMNS = ("x", "y", "yaw", "vx", "vy", "wz")


def write_made(made: tuple[dict, pd.DataFrame, dict], folder: Path) -> dict:
    """Write what the owner believes and the recording of a case into a folder; return its answer, the third of it."""
    nominal, table, answer = made
    folder.mkdir(parents=True, exist_ok=True)
    write_yaml(folder / "nominal.yaml", nominal)
    write_parquet(folder / "recording.parquet", table)
    return answer


def table_of(episodes: list[PlannedEpisode], measured: list[np.ndarray], *, heights: bool) -> pd.DataFrame:
    rows = []
    for e, m in zip(episodes, measured, strict=True):
        n = len(m)
        row = {"episode": np.full(n, e.number, np.int32), "t": np.arange(n) / e.rate_hz}
        row |= dict(zip(COLUMNS, m.T, strict=True))
        row |= dict(zip(("fx", "fy", "px", "py", "pz"), e.command.T, strict=True))
        rows.append(pd.DataFrame(row))
    table = pd.concat(rows, ignore_index=True)
    if not heights:
        table = table.drop(columns="pz")
    return table.astype({name: np.float32 for name in table.columns if name != "episode"})


def nominal_of(world: World, rate_hz: float, noise: dict[str, float], reality: Reality, g: np.random.Generator) -> dict:
    sizes = world.half_size
    drawn = g.random()
    stated: dict[str, float | None] | None = dict(noise)
    if drawn < reality.noise_unknown:
        stated = None
    elif drawn < reality.noise_unknown + reality.noise_partly:
        hidden = g.choice(list(noise), size=int(g.integers(1, len(noise))), replace=False)
        stated = {kind: None if kind in hidden else value for kind, value in noise.items()}
    nominal: dict = {
        "half_size": sizes[0] if sizes[0] == sizes[1] == sizes[2] else list(sizes),
        "mass": world.mass,
        "friction": world.friction,
        "gravity": world.gravity,
        "rate_hz": int(rate_hz),
        "noise": stated,
    }
    if world.contact != "patch":
        nominal["contact"] = world.contact
    return nominal
