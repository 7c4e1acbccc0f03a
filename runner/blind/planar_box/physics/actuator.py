"""What the actuator makes of a command."""

from __future__ import annotations

import math

import numpy as np

from runner.blind.planar_box.physics.world import World


def carried_out(world: World, command: np.ndarray) -> np.ndarray:
    """Return the wrench that the actuator makes of each command before delay and lag, shape (n, 8).

    Columns: force (2, N, world), first moments px fx, px fy, py fx, py fy (N m), height times force (2, N m).
    Order: steps, deadband, gain, crosstalk, limit, misalignment, offset of the point.
    """
    force = np.array(command[:, :2], float)
    if world.quantum > 0.0:
        force = np.round(force / world.quantum) * world.quantum
    if world.deadband > 0.0:
        size = np.hypot(force[:, 0], force[:, 1])
        force *= (np.maximum(size - world.deadband, 0.0) / np.where(size > 0.0, size, 1.0))[:, None]
    force *= world.gain
    if world.crosstalk != 0.0:
        force = np.column_stack([force[:, 0], force[:, 1] + world.crosstalk * force[:, 0] * abs(force[:, 0])])
    if math.isfinite(world.saturation):
        size = np.hypot(force[:, 0], force[:, 1])
        force *= np.minimum(1.0, world.saturation / np.where(size > 0.0, size, 1.0))[:, None]
    if world.misalignment != 0.0:
        c, s = math.cos(world.misalignment), math.sin(world.misalignment)
        force = force @ np.array([[c, s], [-s, c]])
    px, py = command[:, 2] + world.point_offset[0], command[:, 3] + world.point_offset[1]
    fx, fy, pz = force[:, 0], force[:, 1], command[:, 4]
    return np.column_stack([fx, fy, px * fx, px * fy, py * fx, py * fy, pz * fx, pz * fy])
