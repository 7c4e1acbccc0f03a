"""What may be wrong with the recording of a tossed body, in words, and an edit that makes it so."""

from __future__ import annotations

import numpy as np
import pandas as pd

from tests.corruptions import edits
from tests.corruptions.edits import Edit

PLACE, TURN = ("x", "y", "z"), ("qw", "qx", "qy", "qz")


def turned(shift: int) -> Edit:
    """Read quaternions with their numbers that many places further."""

    def edit(table: pd.DataFrame) -> pd.DataFrame:
        return table.assign(**dict(zip(TURN, np.roll(table[list(TURN)].to_numpy(), shift, axis=1).T, strict=True)))

    return edit


TOSSES: dict[str, Edit] = {
    "`x`, `y`, `z` in mm": edits.scaled(1000, *PLACE),
    "`x`, `y`, `z` in cm": edits.scaled(100, *PLACE),
    "`x`, `y`, `z` a thousandth": edits.scaled(1e-3, *PLACE),
    "`x`, `y`, `z` in feet": edits.scaled(1 / 0.3048, *PLACE),
    "y up (`y` and `z` exchanged)": edits.exchanged(("y", "z")),
    "`z` mirrored": edits.scaled(-1, "z"),
    "`y` mirrored, a left-handed world": edits.scaled(-1, "y"),
    "`x` and `y` exchanged": edits.exchanged(("x", "y")),
    "the clock in ms": edits.scaled(1000, "t"),
    "the clock 10 % slow": edits.scaled(1 / 1.1, "t"),
    "quaternions x, y, z, w read as w, x, y, z": turned(-1),
    "quaternions w, x, y, z read as x, y, z, w": turned(1),
    "quaternions of the world against the body": edits.scaled(-1, *TURN[1:]),
    "quaternions not of unit length": edits.scaled(1.2, *TURN),
    "`qw` constant": edits.constant("qw"),
    "`z` 3 cm too high": lambda f: f.assign(z=f["z"] + 0.03),
    "`z` off by 0.1 in one sample": edits.spike("z", 0.1, 20),
    "`x` constant": edits.constant("x"),
}
