"""Bodies as figures and logs draw them."""

from __future__ import annotations

from dataclasses import dataclass

from runner.numerics.polygon import Polygon


@dataclass(frozen=True)
class Shape:
    """A shape of a drawn body: `kind` box | ellipsoid | cylinder | capsule | prism, `size_m` as MuJoCo has it.

    `position_m` (3,), `quaternion_wxyz` (4,): where on the body, in its frame. A prism's size is half that of the box
    around it, and `outline` what it looks like from above.
    """

    kind: str
    size_m: tuple[float, ...]
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    outline: Polygon | None = None


@dataclass(frozen=True)
class DrawnBody:
    """A body as figures and logs draw it."""

    name: str
    shapes: tuple[Shape, ...]
