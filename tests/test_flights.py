"""When nothing touches a free body, and whether anything ever can."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pandas as pd
import pytest
from tosses import COLUMNS, toss_case, world

from runner.recording import Span
from runner.systems.case import open_case
from runner.systems.mechanism import MechanismSystem
from runner.systems.mechanism.flights import flights
from runner.systems.mechanism.models import can_touch

BLOCK = '<body><freejoint/><geom type="box" size=".1 .1 .1"/><geom type="box" size=".1 .1 .1" pos=".1 0 0"/></body>'


def _flights(folder: Path) -> list[list[Span]]:
    system = open_case(folder)
    assert isinstance(system, MechanismSystem)
    return flights(system.recording, system.initial.coordinates, system.context.model)


def test_a_lost_reading_ends_no_flight(tmp_path: Path) -> None:
    """A pose that nobody saw touches nothing; where none was seen at all there is no flight to speak of."""
    folder = toss_case(tmp_path / "case", world(), tosses=2)
    whole = _flights(folder)
    assert whole[0][0].end > 18
    table = pd.read_parquet(folder / "recording.parquet")
    table.loc[[3, 9, 10, 11, 17], list(COLUMNS)] = np.nan
    table.to_parquet(folder / "recording.parquet", index=False)
    assert _flights(folder) == whole


@pytest.mark.parametrize(
    ("beside", "touches"),
    [("", False), ('<geom type="plane" size="1 1 1"/>', True), (BLOCK, True), ('<geom size=".1" contype="0"/>', True)],
)
def test_a_body_that_is_alone_touches_nothing(beside: str, *, touches: bool) -> None:
    """However many geoms it is made of; a geom that others may run into is enough."""
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{beside}{BLOCK}</worldbody></mujoco>")
    assert can_touch(model) == touches
