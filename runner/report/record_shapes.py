"""Bodies in `diagnosis.rrd`: solid where one looks at them, as frames around others for comparison."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from runner.systems.drawing import DrawnBody, Shape

ARCHETYPES: dict[str, Any] = {
    "box": rr.Boxes3D,
    "ellipsoid": rr.Ellipsoids3D,
    "cylinder": rr.Cylinders3D,
    "capsule": rr.Capsules3D,
}
MARK = (248, 249, 250)  # of a body's shapes but the first, as the nose of a box
Colour = tuple[int, int, int]


def kinds(body: DrawnBody) -> list[str]:
    """Return the kinds of shapes of a body."""
    return list(dict.fromkeys(s.kind for s in body.shapes))


def shapes(
    body: DrawnBody, kind: str, *, solid: bool, colour: Colour | None, grown: float, line_m: float
) -> rr.AsComponents:
    """Return the shapes of one kind of a body.

    Args:
        body: What is drawn.
        kind: Of the shapes.
        solid: Or a frame.
        colour: Of all shapes but marks; None: colours are sent over time.
        grown: How much larger they are than the body, so that none hides another.
        line_m: Half the width of a frame's lines.
    """
    of_kind = [s for s in body.shapes if s.kind == kind]
    size = [grown * np.asarray(s.size_m) for s in of_kind]
    at = [tuple(s.position_m) for s in of_kind]
    turned = [rr.Quaternion(xyzw=[*s.quaternion_wxyz[1:], s.quaternion_wxyz[0]]) for s in of_kind]
    look: dict[str, Any] = {
        "colors": None if colour is None else colours(body, kind, colour, solid=solid),
        "fill_mode": "solid" if solid else "majorwireframe",
    }
    if kind == "prism":
        return _prism(of_kind[0], solid=solid, colour=colour, grown=grown, line_m=line_m)
    if kind == "box":
        return rr.Boxes3D(half_sizes=size, centers=at, quaternions=turned, radii=line_m, **look)
    look["line_radii"] = line_m
    if kind == "ellipsoid":
        return rr.Ellipsoids3D(half_sizes=size, centers=at, quaternions=turned, **look)
    radii, lengths = [float(s[0]) for s in size], [2 * float(s[1]) for s in size]
    if kind == "cylinder":
        return rr.Cylinders3D(lengths=lengths, radii=radii, centers=at, quaternions=turned, **look)
    # Rerun's capsule begins at its origin, MuJoCo's is centred there
    ends = [np.asarray(s.position_m) - _turned(s.quaternion_wxyz, np.array([0, 0, s.size_m[1]])) for s in of_kind]
    return rr.Capsules3D(lengths=lengths, radii=radii, translations=ends, quaternions=turned, **look)


def _prism(shape: Shape, *, solid: bool, colour: Colour | None, grown: float, line_m: float) -> rr.AsComponents:
    """Return an upright prism: a mesh, or the lines of its two ends."""
    outline = shape.outline
    assert outline is not None
    height = grown * shape.size_m[2]
    flat = outline.centroid_m + grown * (outline.corners - outline.centroid_m)
    ends = [np.column_stack([flat, np.full(len(flat), z)]) + shape.position_m for z in (-height, height)]
    if not solid:
        closed = [np.vstack([end, end[:1]]) for end in ends]
        return rr.LineStrips3D(closed, radii=line_m, colors=None if colour is None else [colour] * 2)
    # each face has corners of its own, so that edges are sharp
    n, side = len(flat), np.concatenate([np.stack(ends, 1), np.stack([np.roll(e, -1, 0) for e in ends], 1)], 1)
    cap = np.array(outline.triangles())
    wall = 2 * n + 4 * np.arange(n)[:, None]
    faces = np.vstack([cap[:, ::-1], cap + n, wall + np.array([0, 2, 3]), wall + np.array([0, 3, 1])])
    corners = np.vstack([*ends, side.reshape(-1, 3)])
    out = np.roll(flat, -1, 0) - flat
    normal = np.column_stack([out[:, 1], -out[:, 0], np.zeros(n)]) / np.linalg.norm(out, axis=1)[:, None]
    normals = np.vstack([np.tile([0.0, 0, -1], (n, 1)), np.tile([0.0, 0, 1], (n, 1)), np.repeat(normal, 4, axis=0)])
    return rr.Mesh3D(vertex_positions=corners, triangle_indices=faces, vertex_normals=normals, albedo_factor=colour)


def colours_over_time(kind: str, packed: np.ndarray) -> rr.ComponentColumnList:
    """Return the colours (N, 3) of shapes of a kind as columns, which are then partitioned by time."""
    if kind == "prism":
        return rr.Mesh3D.columns(albedo_factor=packed)
    return ARCHETYPES[kind].columns(colors=packed)


def colours(body: DrawnBody, kind: str, colour: Colour, *, solid: bool = True) -> list[Colour]:
    """Return the colour of each shape of a kind: a solid body's first shape has its colour, others mark it."""
    return [MARK if solid and s is not body.shapes[0] and len(body.shapes) > 1 else colour for s in _of(body, kind)]


def _of(body: DrawnBody, kind: str) -> list[Shape]:
    return [s for s in body.shapes if s.kind == kind]


def _turned(quaternion_wxyz: Sequence[float], vector: np.ndarray) -> np.ndarray:
    """Return a vector (3,) turned by a unit quaternion."""
    w, axis = quaternion_wxyz[0], np.asarray(quaternion_wxyz[1:])
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)
