"""Make cases of steel plates that a pin pushed over plastic (MIT Push), for `runner gap` and `runner diagnose`.

    python examples/plates/make_cases.py FOLDER OUT [--friction 0.25] [--pin-friction 0.2] [--driven-by path|force]

FOLDER holds one Parquet file (poses, velocities, the pin's path, measured force and point of contact at 250 Hz),
`outlines.csv` (corners of each plate) and `episodes.csv` (plate, mass, inertia, whether the force is valid) of pushes
from Yu, Bauza, Fazeli and Rodriguez, "More than a Million Ways to Be Pushed" (IROS 2016). The data are not part of this
project. Which pushes are left out of every fit is decided by a hash of their numbers alone: those whose SHA-256 of
"push NUMBER" is divisible by three. OUT gets a folder for each plate, with two cases in it, `fitted` and `left_out`:
the table in planar form, `nominal.yaml`, and the plate's corners. The frictions are guesses, as an owner would make
them.

What drives a plate is the path of the pin: a slow push is balanced by friction within a hair, so that a force with its
errors moves a simulated plate much too far, or not at all. With `--driven-by force` it is the force all the same, of
those plates whose force is valid.
"""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

HALF_HEIGHT_M, RATE_HZ, GRAVITY_M_S2 = 0.0065, 250, 9.81
MEASURED = ["x", "y", "yaw", "vx", "vy", "wz"]
FORCE, POINT, PATH = ["fx", "fy"], ["px", "py"], ["tip_x", "tip_y"]
PIN_RADIUS_M = 0.004745
# the poses in the table are smoothed and their velocities differences of those: what they scatter by says nothing of
# how right they are; about what motion capture of a moving plate is good for
NOISE = {"position": 0.0005, "yaw": 0.005, "velocity": 0.005, "rate": 0.05}
SHARE = 3  # one push in so many is left out


def is_left_out(push: int) -> bool:
    """Whether a push is kept from every fit, by its number alone."""
    return int(hashlib.sha256(f"push {push}".encode()).hexdigest(), 16) % SHARE == 0


def beliefs(
    corners: pd.DataFrame, mass_kg: float, inertia_kg_m2: float, friction: float, pin_friction: float | None, shape: str
) -> dict:
    """Return what `nominal.yaml` says of a plate, and of the pin where its path drives it."""
    half = np.ptp(corners[["x", "y"]].to_numpy(float), axis=0) / 2
    pin = {} if pin_friction is None else {"pin": {"radius": PIN_RADIUS_M, "friction": pin_friction}}
    return {
        "half_size": [*map(float, half), HALF_HEIGHT_M],
        "outline": f"outlines.csv#{shape}",
        "mass": mass_kg,
        "inertia": inertia_kg_m2,
        "friction": friction,
        "gravity": GRAVITY_M_S2,
        "rate_hz": RATE_HZ,
        "noise": NOISE,
        **pin,
    }


def write_case(folder: Path, rows: pd.DataFrame, corners: pd.DataFrame, nominal: dict) -> None:
    """Write a case; where a force drives and the pin does not touch there is no point, and no force worth the name."""
    folder.mkdir(parents=True, exist_ok=True)
    table = rows[["episode", "t", *MEASURED, *FORCE, *POINT]].copy()
    if "pin" in nominal:
        table[PATH] = rows[PATH]
    else:
        touches = rows[POINT].notna().all(axis=1)
        table[FORCE + POINT] = table[FORCE + POINT].where(touches, 0.0)
    table.to_parquet(folder / "recording.parquet", index=False)
    corners.to_csv(folder / "outlines.csv", index=False)
    (folder / "nominal.yaml").write_text(yaml.safe_dump(nominal, sort_keys=False))


def main() -> None:
    """Read the tables, and write two cases of each plate."""
    parser = argparse.ArgumentParser(description="Make cases of pushed plates.")
    parser.add_argument("folder", type=Path, help="holds one Parquet file, outlines.csv, episodes.csv")
    parser.add_argument("out", type=Path)
    parser.add_argument("--friction", type=float, default=0.25, help="believed; default: 0.25")
    parser.add_argument("--pin-friction", type=float, default=0.2, help="believed, between pin and plate; default: 0.2")
    parser.add_argument("--driven-by", choices=("path", "force"), default="path", help="of the pin; default: its path")
    given = parser.parse_args()
    by_path = given.driven_by == "path"
    files = sorted(given.folder.glob("*.parquet"))
    if len(files) != 1:
        parser.error(f"{given.folder}: must hold one Parquet file, holds {len(files)}.")
    table = pd.read_parquet(files[0]).sort_values(by=["episode", "t"])
    episodes = pd.read_csv(given.folder / "episodes.csv")
    outlines = pd.read_csv(given.folder / "outlines.csv")
    usable = episodes if by_path else episodes.loc[episodes["force_valid"], :]
    for shape, pushes in usable.groupby("shape"):
        corners = outlines.loc[outlines["shape"] == shape, :]
        mass, inertia = (float(pushes[name].to_numpy(float)[0]) for name in ("mass_kg", "izz_kg_m2"))
        pin_friction = given.pin_friction if by_path else None
        nominal = beliefs(corners, mass, inertia, given.friction, pin_friction, str(shape))
        numbers = sorted(set(pushes["episode"]) & set(table["episode"]))
        for name, left_out in (("fitted", False), ("left_out", True)):
            chosen = [n for n in numbers if is_left_out(n) == left_out]
            if chosen:
                write_case(given.out / str(shape) / name, table.loc[table["episode"].isin(chosen), :], corners, nominal)
            print(f"{given.out / str(shape) / name}: {len(chosen)} pushes")


if __name__ == "__main__":
    main()
