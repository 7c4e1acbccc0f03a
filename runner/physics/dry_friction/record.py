"""What dry friction knows and says of one body: the layout of its numbers in MuJoCo's `user` and `userdata` arrays.

A body's `user` data is its record (`FrictionRecord`, field by field), then its base points (`POINT_STRIDE` numbers
each), then the corners of its outline (two each), where a pin may touch it, then circles around `SIDES` sides of that
at a time (`CIRCLE` numbers each: centre and radius). Its block of `mjData.userdata` is the push
on it (`PUSH_SIZE` numbers), then what friction says of the last step (`OUT_SIZE` numbers), then where the pin is
(`PIN_SIZE` numbers).
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import mujoco
import numpy as np
from numpy.typing import ArrayLike

MAGIC = 271828.1828  # the first number of a record
PLANAR, UPRIGHT, FREE = 3, 4, 6  # kinds of joints: as many as the body has degrees of freedom
POINT_STRIDE = 4  # x, y, weight, pressure shape
SIDES, CIRCLE = 16, 3  # of an outline: what is far away is passed over by so many sides; centre and radius
PUSH_SIZE = 12
OUT_SIZE = 12
PIN_SIZE = 4  # centre of the pin x, y (world, m) and its velocity (m/s), at the time of the position in this step
PIN_ADR = PUSH_SIZE + OUT_SIZE  # inside the block of a body
USERDATA_SIZE = PIN_ADR + PIN_SIZE  # per body

# Offsets inside the `userdata` block of a body, after the push: friction (world axes, N, film included), its moment
# about the body frame (N m), where the moments ask the load to be (body axes, m; beyond the base it would tip),
# share of the base that is lifted, speed at the end of the step (m/s), power of friction (W, mean over the step), load
# on the base (N), yaw rate (rad/s), force of the pin on the body (world axes, N, mean over the step).
OUT_FORCE, OUT_TORQUE, OUT_COP, OUT_LIFTED, OUT_SLIP, OUT_POWER, OUT_LOAD, OUT_TURN = 0, 2, 3, 5, 6, 7, 8, 9
OUT_PIN = 10


@dataclass
class FrictionRecord:
    """What dry friction knows of one body: the first numbers of the body's `user` data, in this order.

    Lengths in m, speeds in m/s, angles in rad. A neutral value switches an effect off.
    """

    magic: float = MAGIC
    joints: float = PLANAR  # PLANAR: slide x, slide y, hinge z; UPRIGHT: with slide z after y; FREE: a free joint
    push_adr: float = 0  # start of the body's block in userdata
    points: float = 0  # base points; 0: pushes only
    base_z: float = 0.0  # height of the base in the body frame (negative)
    mu: float = 0.0
    # mu * along on the body axis at aniso_angle, mu * across at right angles to it: friction lies on that ellipse.
    # normality 1: slip is at right angles to it (associated); 0: every axis by itself, mu (along p, across q) / u
    along: float = 1.0
    across: float = 1.0
    aniso_angle: float = 0.0
    normality: float = 1.0
    # mu * (1 + stribeck * (exp(-(u / stribeck_speed)^stribeck_exponent) - stribeck_reference)): of speeds far above
    # stribeck_speed mu is the coefficient with reference 0, of rest with reference 1
    stribeck: float = 0.0
    stribeck_speed: float = 0.1
    stribeck_exponent: float = 2.0
    stribeck_reference: float = 0.0
    # mu * (1 + stiction * exp(-(u / stiction_speed)^2))
    stiction: float = 0.0
    stiction_speed: float = 2e-3
    # mu * (1 + patch * s), s = 1 inside a disc of the floor, with a smooth edge
    patch: float = 0.0
    patch_x: float = 0.0
    patch_y: float = 0.0
    patch_radius: float = 0.5
    # a film under the base: force -film / points at each point, against its slip; N s/m in all
    film: float = 0.0
    # -air_drag |v| v at the body frame's origin; N s2/m2
    air_drag: float = 0.0
    # mass and inertia times (1 - mass_leak * t); 1/s
    mass_leak: float = 0.0
    # load carried by the base points besides the weight share: w_k (1 + pressure * shape_k)
    pressure: float = 0.0
    # half sizes of the base, to tell how much of it is lifted; of an outline those of a rectangle with its spread
    half_x: float = 0.0
    half_y: float = 0.0
    # of an outline: a disc that lies within the hull of the base points, centre and radius; 0: the base is a rectangle
    base_x: float = 0.0
    base_y: float = 0.0
    bearing_radius: float = 0.0
    # a pin that moves as it is told and touches the outline: its radius (0: there is none), friction between the two,
    # spring (N/m) and damper (N s/m) of the contact; corners of the outline
    pin_radius: float = 0.0
    pin_friction: float = 0.0
    pin_stiffness: float = 0.0
    pin_damping: float = 0.0
    # ... and how high above the body frame it touches
    pin_height: float = 0.0
    corners: float = 0


FIELDS = tuple(f.name for f in fields(FrictionRecord))
STRIDE = len(FIELDS)
COLUMN = {name: i for i, name in enumerate(FIELDS)}


def pack(record: FrictionRecord, points: np.ndarray, corners: ArrayLike = ()) -> np.ndarray:
    """Return the `user` data of a body: its record, its base points, (n, 4), n may be 0, and its corners, (m, 2)."""
    corners = np.asarray(corners, float).reshape(-1, 2)
    record.points, record.corners = len(points), len(corners)
    numbers = [float(getattr(record, name)) for name in FIELDS]
    return np.concatenate([numbers, np.asarray(points, float).ravel(), corners.ravel(), _circles(corners).ravel()])


def size_of(points: int, corners: int) -> int:
    """Return how many numbers `pack` makes of so many base points and corners."""
    return STRIDE + POINT_STRIDE * points + 2 * corners + CIRCLE * -(-corners // SIDES)


def _circles(corners: np.ndarray) -> np.ndarray:
    """Return centre and radius of circles around `SIDES` sides at a time; side k ends at corner k, (m, 3)."""
    out = []
    for begin in range(0, len(corners), SIDES):
        some = np.vstack([corners[begin - 1], corners[begin : begin + SIDES]])
        centre = (some.min(axis=0) + some.max(axis=0)) / 2
        out.append([*centre, np.linalg.norm(some - centre, axis=1).max()])
    return np.array(out).reshape(-1, CIRCLE)


@dataclass(frozen=True)
class FrictionView:
    """Read and write access to a body's record inside a compiled model, by field name."""

    model: mujoco.MjModel = field(repr=False)
    body_id: int

    def __getitem__(self, name: str) -> float:
        return float(self.model.body_user[self.body_id, COLUMN[name]])

    def __setitem__(self, name: str, value: float) -> None:
        self.model.body_user[self.body_id, COLUMN[name]] = value

    @property
    def points(self) -> np.ndarray:
        """The base points, (n, 4), `base_points` has the columns; what is written there is written into the model."""
        count = int(self["points"])
        return self.model.body_user[self.body_id, STRIDE : STRIDE + count * POINT_STRIDE].reshape(count, POINT_STRIDE)


def base_points(half_x: float, half_y: float, n: int = 8) -> np.ndarray:
    """Return quadrature points of a rectangular base under even load, shape (n*n, 4).

    Columns: x, y (m, body frame), weight (sums to 1), and the shape of a rim-heavy pressure (mean 0, +1 at the
    rim's middle radius). Gauss-Legendre in both axes.
    """
    nodes, weights = np.polynomial.legendre.leggauss(n)
    x, y = (a.ravel() for a in np.meshgrid(nodes, nodes, indexing="ij"))
    w = np.outer(weights, weights).ravel() / 4.0
    return with_pressure_shape(x * half_x, y * half_y, w, np.maximum(abs(x), abs(y)))


def corner_points(half_x: float, half_y: float) -> np.ndarray:
    """Return the four corners as base points, shape (4, 4), for an object that bears on its corners only."""
    x, y = np.array([1.0, 1, -1, -1]), np.array([1.0, -1, 1, -1])
    return with_pressure_shape(x * half_x, y * half_y, np.full(4, 0.25), np.ones(4))


def with_pressure_shape(x: np.ndarray, y: np.ndarray, w: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return base points (n, 4) with a rim-heavy pressure's shape at them; `radius`: 0 in the middle, 1 at the edge.

    2 r^2 - 1 has mean 0 over a square and over any outline around its middle, as r^2 averages 1/2.
    """
    shape = 2.0 * radius**2 - 1.0
    shape = shape - np.sum(w * shape)
    return np.column_stack([x, y, w, shape])
