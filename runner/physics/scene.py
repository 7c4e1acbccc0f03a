"""The scene: boxes on a frictional floor, built with dm-control's `mjcf`, stepped by dm-control's Physics.

Two choices span it. `dof`: `planar` moves in x, y and yaw (the constraint of the published experiment), `free` in all
six degrees of freedom. `contact`: `patch` spreads dry friction over the base by the compiled law (`dry_friction`),
`feet` carries the box on n x n small spheres, `corners` on its four corners.

MuJoCo's stock contact settings let a sliding box hop. The native contacts here use explicit pairs whose normal
direction is soft and direct (`solref` negative), and whose friction rows are hard (`impratio`), see `_pair_settings`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

import mujoco
import numpy as np
from dm_control import mjcf
from numpy.typing import ArrayLike

from runner.errors import ConfigError, check_range, check_vector, nearest
from runner.physics import dry_friction


class Dof(Enum):
    """How a body may move."""

    planar = "planar"
    free = "free"


class Contact(Enum):
    """What carries a body on the floor."""

    patch = "patch"
    feet = "feet"
    corners = "corners"


class Base(Enum):
    """Which part of the base bears under the compiled law: all of it evenly, or its four corners."""

    even = "even"
    corners = "corners"


@dataclass(frozen=True)
class SceneConfig:
    """What all bodies share: `timestep_s`, gravity, the kind of motion and of contact.

    `grid` is the number of base points (patch) or feet along each edge.
    """

    dof: Dof = Dof.planar
    contact: Contact = Contact.patch
    timestep_s: float = 1 / 480
    gravity_m_s2: float = 9.81
    grid: int = 8

    def __post_init__(self) -> None:
        check_range("scene.timestep_s", self.timestep_s, 1e-5, 1 / 50, unit="s")
        check_range("scene.gravity_m_s2", self.gravity_m_s2, 0.1, 100.0, unit="m/s2")
        check_range("scene.grid", self.grid, 2, 16)
        if self.dof is Dof.free and self.contact is Contact.patch:
            raise ConfigError(
                "scene.contact: 'patch' spreads the load of a body that can't tip, so it needs scene.dof=planar; "
                "with scene.dof=free choose 'corners' or 'feet'."
            )


@dataclass(frozen=True)
class BodyConfig:
    """One box. `com_m` is relative to the geometric centre; `inertia_kg_m2` is diagonal, about the CoM, in body axes.

    None for the inertia means that of a uniform box of this mass.
    """

    mass_kg: float
    friction: float
    half_size_m: tuple[float, float, float] = (0.5, 0.5, 0.5)
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    inertia_kg_m2: tuple[float, float, float] | None = None
    base: Base = Base.even

    def __post_init__(self) -> None:
        check_range("mass_kg", self.mass_kg, 0.0, 1e6, unit="kg", lower_open=True)
        check_range("friction", self.friction, 0.0, 10.0)
        check_vector("half_size_m", self.half_size_m, 3, unit="m")
        for i, (half, com) in enumerate(zip(self.half_size_m, self.com_m, strict=True)):
            check_range(f"half_size_m[{i}]", half, 0.0, 100.0, unit="m", lower_open=True)
            check_range(f"com_m[{i}]", com, -half, half, unit="m (inside the body)")
        if self.inertia_kg_m2 is not None:
            check_inertia("inertia_kg_m2", self.inertia_kg_m2)

    @property
    def inertia(self) -> tuple[float, float, float]:
        """Diagonal inertia about the CoM, kg m2."""
        return self.inertia_kg_m2 or box_inertia(self.mass_kg, self.half_size_m)


def box_inertia(mass_kg: float, half_size_m: tuple[float, float, float]) -> tuple[float, float, float]:
    """Return the diagonal inertia of a uniform box about its centre, kg m2: m/3 (b^2 + c^2) in half sizes."""
    a, b, c = half_size_m
    return (mass_kg * (b * b + c * c) / 3, mass_kg * (a * a + c * c) / 3, mass_kg * (a * a + b * b) / 3)


def check_inertia(key: str, inertia: tuple[float, ...]) -> None:
    """Refuse a diagonal inertia that no mass distribution has (positive, triangle inequality)."""
    check_vector(key, inertia, 3, unit="kg m2")
    for i, value in enumerate(inertia):
        check_range(f"{key}[{i}]", value, 0.0, 1e9, unit="kg m2", lower_open=True)
    largest = max(inertia)
    if sum(inertia) - largest < largest * (1 - 1e-9):
        raise ConfigError(
            f"{key}: no body has these moments: each must be at most the sum of the others, got {inertia!r}."
        )


@dataclass(frozen=True)
class Body:
    """Where one body stands in the model's arrays.

    `joints` is `PLANAR` (x, y, yaw), `UPRIGHT` (x, y, z, yaw) or `FREE` (position, quaternion).
    `push_adr` is the start of its block in `mjData.userdata`: 12 numbers of push, then `OUT_SIZE` of output.
    """

    name: str
    body_id: int
    qpos_adr: int
    dof_adr: int
    push_adr: int
    joints: int
    rest_height_m: float  # of the body frame above the floor

    @property
    def nq(self) -> int:
        """Number of positions."""
        return 7 if self.joints == dry_friction.FREE else self.joints

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return self.joints

    def planar_columns(self) -> tuple[tuple[int, int, int], tuple[int, int, int]]:
        """Return where x, y, yaw stand in qpos and vx, vy, wz in qvel; not for a free body.

        Raises:
            ConfigError: If the body is free: its yaw is no entry of qpos.
        """
        if self.joints == dry_friction.FREE:
            raise ConfigError(f"body '{self.name}' is free: its yaw follows from a quaternion, use `pose`.")
        q, v, last = self.qpos_adr, self.dof_adr, self.joints - 1
        return (q, q + 1, q + last), (v, v + 1, v + last)

    def difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Return the way from one of the body's positions (nq,) to another, per degree of freedom, (nv,)."""
        if self.joints != dry_friction.FREE:
            return end - start
        out = np.empty(6)
        out[:3] = end[:3] - start[:3]
        mujoco.mju_subQuat(out[3:], end[3:], start[3:])
        return out

    def move(self, position: np.ndarray, way: np.ndarray) -> None:
        """Move one of the body's positions (nq,), in place, along a `difference` (nv,)."""
        if self.joints != dry_friction.FREE:
            position += way
        else:
            position[:3] += way[:3]
            mujoco.mju_quatIntegrate(position[3:], way[3:], 1.0)

    def pose(self, qpos: np.ndarray) -> np.ndarray:
        """Return position and quaternion (w first) of the body frame in the world, (..., 7), from qpos (..., nq)."""
        q = qpos[..., self.qpos_adr : self.qpos_adr + self.nq]
        if self.joints == dry_friction.FREE:
            return q.copy()
        out = np.zeros((*q.shape[:-1], 7))
        out[..., :2] = q[..., :2]
        out[..., 2] = self.rest_height_m + (q[..., 2] if self.joints == dry_friction.UPRIGHT else 0.0)
        out[..., 3], out[..., 6] = np.cos(q[..., -1] / 2), np.sin(q[..., -1] / 2)
        return out

    def twist(self, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
        """Return the velocity of the body frame's origin and the angular velocity, world axes, (..., 6)."""
        v = qvel[..., self.dof_adr : self.dof_adr + self.nv]
        out = np.zeros((*v.shape[:-1], 6))
        if self.joints == dry_friction.FREE:
            out[..., :3] = v[..., :3]
            out[..., 3:] = rotate(qpos[..., self.qpos_adr + 3 : self.qpos_adr + 7], v[..., 3:])
            return out
        out[..., : self.joints - 1] = v[..., :-1]
        out[..., 5] = v[..., -1]
        return out


def rotate(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Turn vectors (..., 3) by unit quaternions (..., 4), w first."""
    w, u = quaternion[..., :1], quaternion[..., 1:]
    t = 2.0 * np.cross(u, vector)
    return vector + w * t + np.cross(u, t)


def push_columns(force_n: ArrayLike, point_m: ArrayLike) -> np.ndarray:
    """Return what the law takes for forces at body-fixed points, (..., 12): the force, then p x F^T row by row.

    Args:
        force_n: Force, world axes, (..., 3).
        point_m: Point of application relative to the geometric centre, body axes, (..., 3).
    """
    force, point = np.broadcast_arrays(np.asarray(force_n, float), np.asarray(point_m, float))
    moment = point[..., :, None] * force[..., None, :]
    return np.concatenate([force, moment.reshape(*moment.shape[:-2], 9)], axis=-1)


def build(scene: SceneConfig, bodies: Mapping[str, BodyConfig]) -> mjcf.RootElement:
    """Return the MJCF of a floor and these bodies, all starting at the origin, none touching another."""
    dry_friction.install()
    root = mjcf.RootElement(model="runner")
    root.option.timestep = scene.timestep_s
    root.option.gravity = (0.0, 0.0, -scene.gravity_m_s2)
    root.size.nuserdata = dry_friction.USERDATA_SIZE * len(bodies)
    root.size.nuser_body = dry_friction.STRIDE + (
        dry_friction.POINT_STRIDE * scene.grid**2 if scene.contact is Contact.patch else 0
    )
    if scene.contact is Contact.patch:
        root.option.flag.contact = "disable"
        root.option.flag.constraint = "disable"
    else:
        root.option.cone = "elliptic"
        root.option.tolerance = 1e-10
        root.option.impratio = _impratio(scene)
    root.worldbody.add("geom", name="floor", type="plane", size=(50, 50, 1), contype=0, conaffinity=0)
    for i, (name, body) in enumerate(bodies.items()):
        _add_body(root, scene, name, body, dry_friction.USERDATA_SIZE * i)
    return root


def _add_body(root: mjcf.RootElement, scene: SceneConfig, name: str, body: BodyConfig, push_adr: int) -> None:
    hx, hy, hz = body.half_size_m
    joints = (
        dry_friction.FREE
        if scene.dof is Dof.free
        else dry_friction.PLANAR
        if scene.contact is Contact.patch
        else dry_friction.UPRIGHT
    )
    points = np.empty((0, dry_friction.POINT_STRIDE))
    if scene.contact is Contact.patch:
        points = (
            dry_friction.base_points(hx, hy, scene.grid)
            if body.base is Base.even
            else dry_friction.corner_points(hx, hy)
        )
    record = dry_friction.FrictionRecord(
        joints=joints, push_adr=push_adr, base_z=-hz, mu=body.friction, half_x=hx, half_y=hy
    )
    z = hz if joints == dry_friction.PLANAR else hz - _penetration_m(scene)
    # simple="false": MuJoCo must not take the CoM for fixed at the frame, as it may move at run time
    element = root.worldbody.add(
        "body", name=name, pos=(0, 0, z), simple="false", user=dry_friction.pack(record, points)
    )
    element.add("inertial", pos=body.com_m, mass=body.mass_kg, diaginertia=body.inertia)
    if joints == dry_friction.FREE:
        element.add("freejoint", name=name)
    else:
        for axis in "xyz" if joints == dry_friction.UPRIGHT else "xy":
            element.add("joint", name=f"{name}_{axis}", type="slide", axis=[float(axis == a) for a in "xyz"])
        element.add("joint", name=f"{name}_yaw", type="hinge", axis=(0, 0, 1))
    if scene.contact is Contact.feet:
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
        if scene.contact is Contact.corners:
            _add_pair(root, scene, body, box)


def _foot_radius_m(body: BodyConfig, grid: int) -> float:
    return min(body.half_size_m[:2]) / grid / 2


# Contact settings under which MuJoCo's elliptic contact slides by Coulomb's law. Its convex cone adds a normal push
# that grows with slip, D_n mu b_t |slip|, which makes a sliding box hop. The tiny `IMPEDANCE` makes the normal rows so
# soft that the push drowns; a direct `solref` puts the wanted spring and damper back; `solreffriction` gives the
# friction rows their own rate b_t; `impratio` makes those rows hard again, in proportion to the mass.
# Measured: acceleration exact to 1e-12, creep below 0.8 um/s, from 0.3 to 10 kg and friction 0.05 to 1.
#
# What remains is in b_t, whatever the step: the push gives faster points a little more load (in proportion to b_t and
# to the number of contacts; a body that can tip evens some of it out), and speeds below mu g / b_t fade instead of
# stopping dead. `FRICTION_RATE` is the best compromise over 20 s episodes of sliding and spinning.
IMPEDANCE = 1e-4  # the least that MuJoCo takes
FRICTION_RATE = {Dof.planar: 400.0, Dof.free: 1600.0}  # b_t times the root of the number of contacts, 1/s
FRICTION_REGULARISER = 3.5e-5  # per root of the number of contacts, times the mass; the creep is in proportion to it


def _contacts(scene: SceneConfig) -> int:
    return scene.grid**2 if scene.contact is Contact.feet else 4


def _impratio(scene: SceneConfig) -> float:
    return 1 / IMPEDANCE / FRICTION_REGULARISER / math.sqrt(_contacts(scene))


def _penetration_m(scene: SceneConfig) -> float:
    """Static penetration under the body's own weight: the contact spring has omega * dt = 0.5."""
    return scene.gravity_m_s2 * (scene.timestep_s / 0.5) ** 2


def _add_pair(root: mjcf.RootElement, scene: SceneConfig, body: BodyConfig, geom: mjcf.Element) -> None:
    contacts = _contacts(scene)
    pen = _penetration_m(scene)
    stiffness = scene.gravity_m_s2 / contacts / pen
    damping = 2 * math.sqrt(scene.gravity_m_s2 / pen) / contacts
    rate = min(FRICTION_RATE[scene.dof] / math.sqrt(contacts), 1 / scene.timestep_s)
    root.contact.add(
        "pair",
        geom1="floor",
        geom2=geom,
        condim=3,
        friction=(body.friction, body.friction, 0.005, 1e-4, 1e-4),
        solref=(-stiffness, -damping),
        solimp=(IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2),
        solreffriction=(-1.0, -IMPEDANCE * rate),
    )


@dataclass(frozen=True)
class Scene:
    """A compiled scene: dm-control's `physics`, its raw `model` and `data`, and the handles of its bodies."""

    config: SceneConfig
    physics: mjcf.Physics
    bodies: Mapping[str, Body]
    _scratch: mujoco.MjData = field(repr=False)

    @property
    def model(self) -> mujoco.MjModel:
        """The raw MuJoCo model."""
        return self.physics.model.ptr

    @property
    def data(self) -> mujoco.MjData:
        """The raw MuJoCo data."""
        return self.physics.data.ptr

    def body(self, name: str) -> Body:
        """Return the handle of a body.

        Raises:
            ConfigError: If there is none of that name.
        """
        if name not in self.bodies:
            raise ConfigError(f"no body '{name}' in the scene. {nearest(name, self.bodies)}")
        return self.bodies[name]

    def law(self, name: str) -> dry_friction.FrictionView:
        """Return the friction law's record of a body."""
        return dry_friction.FrictionView(self.model, self.body(name).body_id)

    def set_inertial(
        self,
        name: str,
        *,
        mass_kg: float | None = None,
        com_m: np.ndarray | None = None,
        inertia_kg_m2: np.ndarray | None = None,
    ) -> None:
        """Change a body's mass, CoM (body axes, (3,)) or diagonal inertia (about the CoM, (3,)) while running."""
        set_inertial(
            self.model,
            self._scratch,
            self.body(name).body_id,
            mass_kg=mass_kg,
            com_m=com_m,
            inertia_kg_m2=inertia_kg_m2,
        )


def set_inertial(
    model: mujoco.MjModel,
    scratch: mujoco.MjData,
    body_id: int,
    *,
    mass_kg: float | None = None,
    com_m: np.ndarray | None = None,
    inertia_kg_m2: np.ndarray | None = None,
) -> None:
    """Write inertial properties and what MuJoCo derives from them.

    `mj_setConst` overwrites the state of the data it is given, hence the `scratch` data.
    """
    if mass_kg is not None:
        model.body_mass[body_id] = mass_kg
    if com_m is not None:
        model.body_ipos[body_id] = com_m
    if inertia_kg_m2 is not None:
        model.body_inertia[body_id] = inertia_kg_m2
    mujoco.mj_setConst(model, scratch)


def compile_scene(scene: SceneConfig, bodies: Mapping[str, BodyConfig]) -> Scene:
    """Build and compile a scene; `legacy_step` is off, so that a step is exactly MuJoCo's `mj_step`."""
    physics = mjcf.Physics.from_mjcf_model(build(scene, bodies))
    physics.legacy_step = False
    return Scene(scene, physics, handles(physics.model.ptr, list(bodies)), mujoco.MjData(physics.model.ptr))


def handles(model: mujoco.MjModel, names: list[str]) -> dict[str, Body]:
    """Return the handles of bodies that are under the law, by name."""
    out = {}
    for name in names:
        body = model.body(name)
        view = dry_friction.FrictionView(model, body.id)
        joint = int(model.body_jntadr[body.id])
        joints = int(view["joints"])
        out[name] = Body(
            name=name,
            body_id=body.id,
            qpos_adr=int(model.jnt_qposadr[joint]),
            dof_adr=int(model.jnt_dofadr[joint]),
            push_adr=int(view["push_adr"]),
            joints=joints,
            rest_height_m=float(model.body_pos[body.id][2]),
        )
    return out
