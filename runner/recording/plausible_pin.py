"""Whether the path of a pin is one on which it pushes the body: touches it, does not go through it, works on it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from runner.numerics.arrays import FloatArray
from runner.numerics.polygon import Polygon
from runner.recording.data import WARNING, BelievedPin, Nominal
from runner.recording.plausible_forces import turned
from runner.recording.plausible_pairs import place
from runner.recording.table import FORCE, PIN, Table
from runner.settings import SETTINGS


def pin_notes(table: Table, pin: BelievedPin, nominal: Nominal) -> list[str]:
    """Return a note where the pin is inside the body as believed while it touches it, or never comes near it.

    Args:
        table: Of a planar body, without gaps.
        pin: As believed.
        nominal: What is believed of the body.
    """
    depth = pin.radius_m - _outline(nominal).distance_m(_in_body_axes(table))
    allowed, row = SETTINGS.forces.max_pin_depth * min(nominal.half_size_m[:2]), int(np.argmax(depth))
    if depth[row] < -allowed:
        return [
            f"{WARNING}the pin pushes nothing: it stays {-1e3 * depth[row]:.3g} mm or more off the body as believed. "
            "Are 'tip_x', 'tip_y' of its middle, and 'x', 'y' of the body's?"
        ]
    inside = depth[depth > 0.0]
    usual = float(np.median(inside)) if len(inside) else 0.0
    if usual <= allowed:
        return []
    return [
        f"{WARNING}where the pin touches the body as believed it is {1e3 * usual:.3g} mm inside it by the median, most "
        f"at {place(table, row)}: is 'half_size' half of the edges, 'pin: radius' right, and are 'tip_x', 'tip_y' of "
        "the pin's middle?"
    ]


def pin_force_notes(table: Table, spans: Sequence[slice]) -> list[str]:
    """Return a note where the measured force holds the pin's way: a pin that pushes gives, and never takes.

    Args:
        table: Of a planar body.
        spans: Rows of each episode.
    """
    force, path = np.nan_to_num(table.stack(FORCE[:2])), table.stack(PIN)
    ways = [(0.5 * (force[s][1:] + force[s][:-1]), np.diff(path[s], axis=0)) for s in spans]
    work_j = sum(float(np.sum(f * way)) for f, way in ways)
    most_j = sum(float(np.sum(np.linalg.norm(f, axis=1) * np.linalg.norm(way, axis=1))) for f, way in ways)
    if work_j >= -SETTINGS.forces.explained_share * most_j:
        return []
    return [
        f"{WARNING}the force 'fx', 'fy' of the pin is against its way ({work_j:.3g} J in all), as that of the body on "
        "the pin is: it must be that of the pin on the body, the other sign (`scale: -1` in an import map)"
    ]


def _outline(nominal: Nominal) -> Polygon:
    """Return the body seen from above, in its own axes."""
    x, y = nominal.half_size_m[:2]
    return nominal.outline or Polygon(((-x, -y), (x, -y), (x, y), (-x, y)))


def _in_body_axes(table: Table) -> FloatArray:
    """Return the pin's middle relative to the body's, in the body's axes, (T, 2)."""
    return turned(table.stack(PIN) - table.stack(("x", "y")), -table["yaw"])
