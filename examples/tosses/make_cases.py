"""Make cases of the tosses of an acrylic cube that ContactNets published, ready for `runner gap` and `runner diagnose`.

    python examples/tosses/make_cases.py FOLDER OUT [--tosses 60] [--friction 1.0]

FOLDER holds `train.parquet`: episode, t, x, y, z, qw, qx, qy, qz of every toss. Which tosses are left out of every fit
is decided by a hash of their numbers alone: those whose SHA-256 of "toss NUMBER" is divisible by three. OUT gets two
cases, `fitted` and `left_out`, each with its table, `nominal.yaml` and a stock MJCF of the cube on a table, whose
contacts are what MuJoCo has where nobody sets anything. Velocities of the log are smoothed differences of the poses,
half a sample late; they tell nothing that the poses do not, and are left out.
"""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

SIDE_M, MASS_KG, INERTIA_KG_M2 = 0.1048, 0.37, 0.00081  # as published
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
SHARE = 3  # one toss in so many is left out
MODEL = f"""<mujoco model="cube">
  <option timestep="0.001" integrator="implicitfast"/>
  <worldbody>
    <geom name="table" type="plane" size="2 2 0.1"/>
    <body name="cube" pos="0 0 0.2">
      <freejoint name="cube"/>
      <inertial pos="0 0 0" mass="{MASS_KG}" diaginertia="{INERTIA_KG_M2} {INERTIA_KG_M2} {INERTIA_KG_M2}"/>
      <geom name="cube" type="box" size="{SIDE_M / 2} {SIDE_M / 2} {SIDE_M / 2}" FRICTION/>
    </body>
  </worldbody>
</mujoco>
"""
NOMINAL = {
    "model": "model.xml",
    "channels": {
        **{axis: {"body": "cube", "quantity": "position", "axis": axis} for axis in "xyz"},
        "quat": {"body": "cube", "quantity": "orientation", "columns": POSE[3:]},
    },
}


def is_left_out(toss: int) -> bool:
    """Whether a toss is kept from every fit, by its number alone."""
    return int(hashlib.sha256(f"toss {toss}".encode()).hexdigest(), 16) % SHARE == 0


def model(friction: float) -> str:
    """Return the stock MJCF; friction 1 is what MuJoCo has by itself."""
    return MODEL.replace("FRICTION", f'friction="{friction:g}" priority="1"' if friction != 1.0 else "")


def spread(tosses: list[int], count: int | None) -> list[int]:
    """Return so many tosses, evenly spread over all; None: all."""
    if count is None or count >= len(tosses):
        return tosses
    return [tosses[i] for i in np.linspace(0, len(tosses) - 1, count).round().astype(int)]


def write_case(folder: Path, table: pd.DataFrame, tosses: list[int], friction: float) -> None:
    """Write a case of some tosses, with the numbers that they have in the table."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = table.loc[table["episode"].isin(tosses), ["episode", "t", *POSE]].sort_values(["episode", "t"])
    rows.to_parquet(folder / "recording.parquet", index=False)
    (folder / "model.xml").write_text(model(friction))
    (folder / "nominal.yaml").write_text(yaml.safe_dump(NOMINAL, sort_keys=False))


def main() -> None:
    """Read the table, and write both cases."""
    parser = argparse.ArgumentParser(description="Make cases of the tosses of ContactNets.")
    parser.add_argument("folder", type=Path, help="holds train.parquet")
    parser.add_argument("out", type=Path)
    parser.add_argument("--tosses", type=int, help="of each case, spread evenly; default: all")
    parser.add_argument("--friction", type=float, default=1.0, help="in the MJCF; default: MuJoCo's own")
    given = parser.parse_args()
    table = pd.read_parquet(given.folder / "train.parquet")
    tosses = sorted(int(e) for e in table["episode"].unique())
    for name, left_out in (("fitted", False), ("left_out", True)):
        chosen = spread([e for e in tosses if is_left_out(e) == left_out], given.tosses)
        write_case(given.out / name, table, chosen, given.friction)
        print(f"{given.out / name}: {len(chosen)} tosses")


if __name__ == "__main__":
    main()
