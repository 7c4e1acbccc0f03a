"""The MJCF of a scene."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike

from runner.numerics.polygon import Polygon
from runner.physics import dry_friction
from runner.physics.scene.config import Base, BodyConfig, Dof, FloorContact, PinConfig, SceneConfig
from runner.physics.scene.contact import coefficients, floor_contact, impratio, penetration_m


def push_columns(force_n: ArrayLike, point_m: ArrayLike) -> np.ndarray:
    """Return what dry friction takes for forces at body-fixed points, (..., 12): the force, then p x F^T row by row.

    Args:
        force_n: Force, world axes, (..., 3).
        point_m: Point of application relative to the geometric centre, body axes, (..., 3).
    """
    force, point = np.broadcast_arrays(np.asarray(force_n, float), np.asarray(point_m, float))
    moment = point[..., :, None] * force[..., None, :]
    return np.concatenate([force, moment.reshape(*moment.shape[:-2], 9)], axis=-1)


# A contact with a pin gives way by so much under the body's weight: far less than anybody measures. Its damper is twice
# the critical one of the body on that spring: a pin that strikes does not send the body ahead.
PIN_GIVES_M, PIN_DAMPING = 2e-5, 2.0


def build(
    scene: SceneConfig,
    bodies: Mapping[str, BodyConfig],
    outlines: Mapping[str, Polygon] = MappingProxyType({}),
    pins: Mapping[str, PinConfig] = MappingProxyType({}),
) -> mjcf.RootElement:
    """Return the MJCF of a floor and these bodies, all starting at the origin, none touching another.

    Args:
        scene: What they share.
        bodies: By name.
        outlines: Of those whose base is no rectangle, relative to the body frame; they need `FloorContact.patch`.
        pins: Those that may touch a body, by the name of the body; they need `FloorContact.patch`.
    """
    dry_friction.install()
    root = mjcf.RootElement(model="runner")
    root.option.timestep = scene.timestep_s
    root.option.gravity = (0.0, 0.0, -scene.gravity_m_s2)
    root.size.nuserdata = dry_friction.USERDATA_SIZE * len(bodies)
    bases = {name: _base_points(scene, body, outlines.get(name)) for name, body in bodies.items()}
    most = max(map(len, bases.values()), default=0)
    sides = {name: _corners(bodies[name], outlines.get(name)) for name in pins}
    most_corners = max(map(len, sides.values()), default=0)
    root.size.nuser_body = dry_friction.size_of(most, most_corners)
    if scene.contact is FloorContact.patch:
        root.option.flag.contact = "disable"
        root.option.flag.constraint = "disable"
    else:
        root.option.cone = "elliptic"
        root.option.tolerance = 1e-10
        root.option.impratio = impratio(_contacts(scene))
    root.worldbody.add("geom", name="floor", type="plane", size=(50, 50, 1), contype=0, conaffinity=0)
    for i, (name, body) in enumerate(bodies.items()):
        record = dry_friction.FrictionRecord(push_adr=dry_friction.USERDATA_SIZE * i)
        if name in outlines:
            _describe(record, outlines[name], bases[name])
        else:
            record.half_x, record.half_y, _ = body.half_size_m
        if name in pins:
            _describe_pin(record, pins[name], body.mass_kg, scene.gravity_m_s2)
        _add_body(root, scene, name, body, record, bases[name], sides.get(name, ()))
    return root


def _base_points(scene: SceneConfig, body: BodyConfig, outline: Polygon | None) -> np.ndarray:
    """Return the base points of a body, (n, 4); none where MuJoCo's contacts carry it."""
    hx, hy, _ = body.half_size_m
    if scene.contact is not FloorContact.patch:
        return np.empty((0, dry_friction.POINT_STRIDE))
    if outline is not None:
        return dry_friction.outline_points(outline, scene.grid)
    return (
        dry_friction.base_points(hx, hy, scene.grid) if body.base is Base.even else dry_friction.corner_points(hx, hy)
    )


def _describe(record: dry_friction.FrictionRecord, outline: Polygon, points: np.ndarray) -> None:
    """Enter a base of any outline into a body's record."""
    # a rectangle has half its edge squared over three
    record.half_x, record.half_y = map(float, np.sqrt(3 * np.diag(outline.spread_m2)))
    record.base_x, record.base_y = map(float, outline.centroid_m)
    record.bearing_radius = dry_friction.bearing_radius(points)


def _corners(body: BodyConfig, outline: Polygon | None) -> np.ndarray:
    """Return the corners of a body seen from above, (n, 2)."""
    hx, hy, _ = body.half_size_m
    return np.array([[hx, hy], [-hx, hy], [-hx, -hy], [hx, -hy]]) if outline is None else outline.corners


def _describe_pin(record: dry_friction.FrictionRecord, pin: PinConfig, mass_kg: float, gravity_m_s2: float) -> None:
    """Enter a pin into a body's record."""
    record.pin_radius, record.pin_friction, record.pin_height = pin.radius_m, pin.friction, pin.height_m
    record.pin_stiffness = mass_kg * gravity_m_s2 / PIN_GIVES_M
    record.pin_damping = PIN_DAMPING * 2 * math.sqrt(record.pin_stiffness * mass_kg)


def _add_body(
    root: mjcf.RootElement,
    scene: SceneConfig,
    name: str,
    body: BodyConfig,
    record: dry_friction.FrictionRecord,
    points: np.ndarray,
    corners: ArrayLike,
) -> None:
    hx, hy, hz = body.half_size_m
    joints = (
        dry_friction.FREE
        if scene.dof is Dof.free
        else dry_friction.PLANAR
        if scene.contact is FloorContact.patch
        else dry_friction.UPRIGHT
    )
    record.joints, record.base_z, record.mu = joints, -hz, body.friction
    z = hz if joints == dry_friction.PLANAR else hz - penetration_m(scene.gravity_m_s2, scene.timestep_s)
    # simple="false": MuJoCo must not take the CoM for fixed at the frame, as it may move at run time
    element = root.worldbody.add(
        "body", name=name, pos=(0, 0, z), simple="false", user=dry_friction.pack(record, points, corners)
    )
    element.add("inertial", pos=body.com_m, mass=body.mass_kg, diaginertia=body.inertia)
    if joints == dry_friction.FREE:
        element.add("freejoint", name=name)
    else:
        for axis in "xyz" if joints == dry_friction.UPRIGHT else "xy":
            element.add("joint", name=f"{name}_{axis}", type="slide", axis=[float(axis == a) for a in "xyz"])
        element.add("joint", name=f"{name}_yaw", type="hinge", axis=(0, 0, 1))
    if scene.contact is FloorContact.feet:
        n, r = scene.grid, _foot_radius_m(body, scene.grid)
        # at the middle of equal cells, spread so that the second moments are those of the base
        grid = ((np.arange(n) + 0.5) / n * 2 - 1) * math.sqrt(n * n / (n * n - 1))
        for k, (x, y) in enumerate((x, y) for x in grid for y in grid):
            foot = element.add(
                "geom",
                name=f"{name}_foot{k}",
                type="sphere",
                size=(r,),
                pos=(x * hx, y * hy, r - hz),
                contype=0,
                conaffinity=0,
            )
            _add_pair(root, scene, body, foot)
        element.add("geom", name=name, type="box", size=(hx, hy, hz), contype=0, conaffinity=0)
    else:
        box = element.add("geom", name=name, type="box", size=(hx, hy, hz), contype=0, conaffinity=0)
        if scene.contact is FloorContact.corners:
            _add_pair(root, scene, body, box)


def _foot_radius_m(body: BodyConfig, grid: int) -> float:
    return min(body.half_size_m[:2]) / grid / 2


def _contacts(scene: SceneConfig) -> int:
    return scene.grid**2 if scene.contact is FloorContact.feet else 4


def _add_pair(root: mjcf.RootElement, scene: SceneConfig, body: BodyConfig, geom: mjcf.Element) -> None:
    contacts = _contacts(scene)
    sunk_m = penetration_m(scene.gravity_m_s2, scene.timestep_s)
    root.contact.add(
        "pair",
        geom1="floor",
        geom2=geom,
        friction=coefficients(body.friction),
        **floor_contact(1 / contacts, sunk_m, scene, contacts),
    )
