"""Bodies as figures and logs draw them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Shape:
    """A shape of a drawn body: `kind` box | sphere | cylinder | capsule, `size_m` as MuJoCo has it, where on the body.

    `position_m` (3,), `quaternion_wxyz` (4,), both in the body's frame.
    """

    kind: str
    size_m: tuple[float, ...]
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class DrawnBody:
    """A body as figures and logs draw it."""

    name: str
    shapes: tuple[Shape, ...]
