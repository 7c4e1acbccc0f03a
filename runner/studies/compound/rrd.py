"""The compound object and the fitted box for the Rerun viewer."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from runner.estimation.space.inertial import Inertial
from runner.studies.compound.fit import InertialFit
from runner.studies.compound.pokes import Part
from runner.studies.plumb_line import log_estimate


def write_rrd(
    file: Path,
    parts: Sequence[Part],
    half_size_m: np.ndarray,
    motion: np.ndarray,
    rate_hz: float,
    true: Inertial,
    found: InertialFit,
) -> None:
    """Write for the Rerun viewer how the object moved, all episodes one after the other, and its CoM as fitted."""
    import rerun as rr  # which no other run should wait for
    import rerun.blueprint as rrb

    from runner.viewer.rrd import written

    view = rrb.Spatial3DView(origin="/world", name="hanging in turn; blue: true centre of mass, white: fitted")
    layout = rrb.Blueprint(view, rrb.TimePanel(state="collapsed", timeline="sim_time"), auto_views=False)
    states = motion.reshape(-1, motion.shape[-1])
    time_s = np.arange(1, len(states) + 1) / rate_hz
    with written(file, layout) as recording:
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        boxes = rr.Boxes3D(
            half_sizes=[part.half_size_m for part in parts],
            centers=[part.centre_m for part in parts],
            colors=[(240, 140, 40)],
            radii=0.004,
        )
        recording.log("world/object/parts", boxes, static=True)
        hull = rr.Boxes3D(half_sizes=[half_size_m], colors=[(150, 150, 150)], radii=0.002)
        recording.log("world/object/hull", hull, static=True)
        recording.log("world/object/true", rr.Points3D([true.com_m], colors=[(70, 130, 220)], radii=0.015), static=True)
        log_estimate(recording, "world/object/estimate", found.body.com_m, found.covariance[1:4, 1:4])
        recording.send_columns(
            "world/object",
            [rr.TimeColumn("sim_time", duration=np.round(1e9 * time_s).astype("timedelta64[ns]"))],
            rr.Transform3D.columns(translation=states[:, :3], quaternion=states[:, [4, 5, 6, 3]]),
        )
