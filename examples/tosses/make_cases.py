"""Make cases of the tosses of an acrylic cube that ContactNets published, ready for `runner gap` and `runner diagnose`.

    python examples/tosses/make_cases.py FOLDER OUT [--tosses 60] [--friction 1.0] [--belief KEY=VALUE ...]

FOLDER holds one Parquet file: episode, t, x, y, z, qw, qx, qy, qz of every toss. Which tosses are left out of every fit
is decided by a hash of their numbers alone: those whose SHA-256 of "toss NUMBER" is divisible by three. OUT gets two
cases, `fitted` and `left_out`, each with its table, `nominal.yaml` and a stock MJCF of the cube on a table, whose
contacts are what MuJoCo has where nobody sets anything. Velocities of the log are smoothed differences of the poses,
half a sample late; they tell nothing that the poses do not, and are left out.

A belief makes the case wrong on purpose, to see whether a diagnosis says so: `size` and `friction` are factors,
`tilt_deg` turns gravity about y, `com_m` moves the centre of mass along x, and `clock` is a factor on the time stamps.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

SIDE_M, MASS_KG, INERTIA_KG_M2 = 0.1048, 0.37, 0.00081  # as published
POSE = ["x", "y", "z", "qw", "qx", "qy", "qz"]
SHARE = 3  # one toss in so many is left out
MODEL = """<mujoco model="cube">
  <option timestep="0.001" integrator="implicitfast" {option}/>
  <worldbody>
    <geom name="table" type="plane" size="2 2 0.1"/>
    <body name="cube" pos="0 0 0.2">
      <freejoint name="cube"/>
      <inertial pos="{com_m} 0 0" mass="{mass}" diaginertia="{inertia} {inertia} {inertia}"/>
      <geom name="cube" type="box" size="{half} {half} {half}" {geom}/>
    </body>
  </worldbody>
</mujoco>
"""
BELIEFS = {"size": 1.0, "friction": 1.0, "tilt_deg": 0.0, "com_m": 0.0, "clock": 1.0}
GRAVITY_M_S2 = 9.81
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


def model(friction: float, cone: str | None = None, beliefs: Mapping[str, float] = BELIEFS) -> str:
    """Return the stock MJCF; friction 1 and the pyramidal cone are what MuJoCo has by itself."""
    friction, option = friction * beliefs["friction"], []
    if beliefs["tilt_deg"]:
        tilt = np.radians(beliefs["tilt_deg"])
        option.append(f'gravity="{-GRAVITY_M_S2 * np.sin(tilt):.9g} 0 {-GRAVITY_M_S2 * np.cos(tilt):.9g}"')
    if cone:
        option.append(f'cone="{cone}"')
    return MODEL.format(
        option=" ".join(option),
        com_m=beliefs["com_m"],
        mass=MASS_KG,
        inertia=INERTIA_KG_M2,
        half=SIDE_M / 2 * beliefs["size"],
        geom=f'friction="{friction:g}" priority="1"' if friction != 1.0 else "",
    )


def beliefs_of(given: Sequence[str]) -> dict[str, float]:
    """Return all beliefs from those that were given as KEY=VALUE."""
    out = dict(BELIEFS)
    for item in given:
        key, _, value = item.partition("=")
        if key not in out:
            raise SystemExit(f"--belief: '{key}' is none of {', '.join(out)}")
        out[key] = float(value)
    return out


def spread(tosses: list[int], count: int | None) -> list[int]:
    """Return so many tosses, evenly spread over all; None: all."""
    if count is None or count >= len(tosses):
        return tosses
    return [tosses[i] for i in np.linspace(0, len(tosses) - 1, count).round().astype(int)]


def write_case(folder: Path, table: pd.DataFrame, tosses: list[int], mjcf: str, clock: float) -> None:
    """Write a case of some tosses, with the numbers that they have in the table."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = table.loc[table["episode"].isin(tosses), ["episode", "t", *POSE]].sort_values(["episode", "t"])
    rows.assign(t=rows["t"] * clock).to_parquet(folder / "recording.parquet", index=False)
    (folder / "model.xml").write_text(mjcf)
    (folder / "nominal.yaml").write_text(yaml.safe_dump(NOMINAL, sort_keys=False))


def main() -> None:
    """Read the table, and write both cases."""
    parser = argparse.ArgumentParser(description="Make cases of the tosses of ContactNets.")
    parser.add_argument("folder", type=Path, help="holds one Parquet file")
    parser.add_argument("out", type=Path)
    parser.add_argument("--tosses", type=int, help="of each case, spread evenly; default: all")
    parser.add_argument("--friction", type=float, default=1.0, help="in the MJCF; default: MuJoCo's own")
    parser.add_argument("--cone", choices=("pyramidal", "elliptic"), help="in the MJCF; default: MuJoCo's own")
    parser.add_argument("--belief", action="append", default=[], metavar="KEY=VALUE", help="see above; may be repeated")
    given = parser.parse_args()
    beliefs = beliefs_of(given.belief)
    mjcf = model(given.friction, given.cone, beliefs)
    files = sorted(given.folder.glob("*.parquet"))
    if len(files) != 1:
        parser.error(f"{given.folder}: must hold one Parquet file, holds {len(files)}.")
    table = pd.read_parquet(files[0])
    tosses = sorted(int(e) for e in table["episode"].unique())
    for name, left_out in (("fitted", False), ("left_out", True)):
        chosen = spread([e for e in tosses if is_left_out(e) == left_out], given.tosses)
        write_case(given.out / name, table, chosen, mjcf, beliefs["clock"])
        print(f"{given.out / name}: {len(chosen)} tosses")


if __name__ == "__main__":
    main()
