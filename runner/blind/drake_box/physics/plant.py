"""The box on its floor as a `MultibodyPlant`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from runner.blind.drake_box.physics.base import RADIUS_M, Base
from runner.blind.drake_box.physics.scene import Scene
from runner.blind.drake_engine import drake, ground_material, half_of, material
from runner.blind.planar_box.physics import World

CHANGE = 2e-3  # relative: smaller changes of a coefficient are kept back
WALL_N_PER_M = 1e5


class BoxOnFloor:
    """The plant, its context, and what is told to it while it runs.

    The contact is Drake's point contact between spheres on springs and the floor, solved by its `tamsi`, the one that
    keeps Coulomb's law as it is. `sap` and `similar` let fast points carry more: a box of half a metre that is thrown
    at 1 m/s and 2 rad/s turns a quarter less far. With `lagged` the load is behind the friction by one step, which
    turns a box whose direction of sliding turns.

    Args:
        scene: What is simulated.
        base: Points that carry the box.
        step_s: Of the discrete plant.
    """

    def __init__(self, scene: Scene, base: Base, step_s: float) -> None:
        self._scene, self._base = scene, base
        multibody, builder = drake("multibody.plant"), drake("systems.framework").DiagramBuilder()
        config = multibody.MultibodyPlantConfig(
            time_step=step_s, discrete_contact_approximation="tamsi", contact_model="point", stiction_tolerance=1e-4
        )
        self._plant, self._scene_graph = multibody.AddMultibodyPlant(config, builder)
        world = scene.world
        down = world.gravity * np.array([
            math.sin(world.tilt) * math.cos(world.downhill), math.sin(world.tilt) * math.sin(world.downhill),
            -math.cos(world.tilt),
        ])  # fmt: skip
        self._plant.mutable_gravity_field().set_gravity_vector(down)
        self._body = self._plant.AddRigidBody("box", inertia_of(world, 1.0 - scene.strange.loose_share))
        self._points = self._touching()
        if scene.strange.wall_distance is not None:
            self._add_wall(scene.strange.wall_distance)
        if scene.strange.loose_share > 0.0:
            self._add_loose_mass()
        self._plant.Finalize()
        self._diagram = builder.Build()
        self._simulator = drake("systems.analysis").Simulator(self._diagram)
        self._step_s, self._steps = step_s, 0
        self._forces = np.zeros(self._plant.num_velocities())
        self._begin()

    def _begin(self) -> None:
        root = self._diagram.CreateDefaultContext()
        self._simulator.reset_context(root)
        self._context = self._plant.GetMyMutableContextFromRoot(root)
        self._seen = self._scene_graph.GetMyMutableContextFromRoot(root)
        self._told = np.full(len(self._points), self._scene.world.friction)
        self._steps = 0

    def _touching(self) -> list[tuple[Any, Any]]:
        geometry, transform = drake("geometry"), drake("math").RigidTransform
        floor = ground_material(dissipation_s_per_m=0.0)
        self._plant.RegisterCollisionGeometry(
            self._plant.world_body(), transform(), geometry.HalfSpace(), "floor", floor
        )
        base, height = self._base, RADIUS_M - self._scene.world.half_size[2]
        points = []
        for k, (x, y, share) in enumerate(zip(base.x, base.y, base.share, strict=True)):
            properties = material(
                stiffness_n_per_m=base.stiffness_n_per_m * share,
                dissipation_s_per_m=base.dissipation_s_per_m,
                friction=half_of(self._scene.world.friction),
            )
            ball = geometry.Sphere(RADIUS_M)
            name = self._plant.RegisterCollisionGeometry(
                self._body, transform([x, y, height]), ball, f"point_{k}", properties
            )
            points.append((name, properties))
        return points

    def _add_wall(self, distance: float) -> None:
        geometry, transform = drake("geometry"), drake("math").RigidTransform
        way, mu = self._scene.strange.wall_direction, self._scene.strange.wall_friction
        inward = -np.array([math.cos(way), math.sin(way), 0.0])
        pose = geometry.HalfSpace.MakePose(inward, -inward * distance)
        bounce = ground_material(dissipation_s_per_m=0.0)
        self._plant.RegisterCollisionGeometry(self._plant.world_body(), pose, geometry.HalfSpace(), "wall", bounce)
        hx, hy, _ = self._scene.world.half_size
        for k, (sx, sy) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
            corner = material(stiffness_n_per_m=WALL_N_PER_M, dissipation_s_per_m=5.0, friction=half_of(mu))
            at = transform([sx * (hx - RADIUS_M), sy * (hy - RADIUS_M), 0.0])
            self._plant.RegisterCollisionGeometry(self._body, at, geometry.Sphere(RADIUS_M), f"corner_{k}", corner)

    def _add_loose_mass(self) -> None:
        tree, s, world = drake("multibody.tree"), self._scene.strange, self._scene.world
        mass = s.loose_share * world.mass
        stiffness = mass * (2.0 * math.pi * s.loose_hz) ** 2
        small = tree.SpatialInertia(1e-4 * mass, np.zeros(3), tree.UnitInertia.SolidSphere(0.05))
        ball = tree.SpatialInertia(mass, np.zeros(3), tree.UnitInertia.SolidSphere(0.05))
        parent = self._body
        for name, axis, inertia in (("x", [1.0, 0.0, 0.0], small), ("y", [0.0, 1.0, 0.0], ball)):
            child = self._plant.AddRigidBody(f"loose_{name}", inertia)
            damping = 2.0 * s.loose_damping * math.sqrt(stiffness * mass)
            slide = tree.PrismaticJoint(f"loose_{name}", parent.body_frame(), child.body_frame(), axis, damping=damping)
            joint = self._plant.AddJoint(slide)
            self._plant.AddForceElement(tree.PrismaticSpring(joint, 0.0, stiffness))
            parent = child

    def place(self, start: np.ndarray) -> None:
        """Put the box on the floor, its springs loaded as they are when it moves like that.

        Args:
            start: x, y, yaw, vx, vy, wz of the geometric centre, shape (6,).
        """
        self._begin()
        world, base = self._scene.world, self._base
        x, y, yaw, vx, vy, wz = (float(v) for v in start)
        speed = math.hypot(vx, vy)
        lean = world.friction * world.half_size[2] / speed if speed > 0.0 else 0.0
        c, s = math.cos(yaw), math.sin(yaw)
        ahead = world.com[0] + lean * (c * vx + s * vy), world.com[1] + lean * (c * vy - s * vx)
        sink = base.sink_m * math.cos(world.tilt)
        pitch = sink * ahead[0] / float(base.share @ base.x**2)
        roll = -sink * ahead[1] / float(base.share @ base.y**2)
        rotation = drake("math").RollPitchYaw(roll, pitch, yaw).ToQuaternion().wxyz()
        self._plant.SetPositions(self._context, np.concatenate([
            rotation, [x, y, world.half_size[2] - sink], np.zeros(self._plant.num_positions() - 7),
        ]))  # fmt: skip
        velocities = np.zeros(self._plant.num_velocities())
        velocities[2:5] = wz, vx, vy
        self._plant.SetVelocities(self._context, velocities)

    def lighten(self, share: float) -> None:
        """Set mass and inertia to a share of what they are at the start."""
        share *= 1.0 - self._scene.strange.loose_share
        self._body.SetSpatialInertiaInBodyFrame(self._context, inertia_of(self._scene.world, share))

    def rub(self, coefficients: np.ndarray) -> None:
        """Set the coefficients of friction of the points, shape (n,)."""
        geometry, coulomb = drake("geometry"), drake("multibody.plant").CoulombFriction
        source = self._plant.get_source_id()
        for k in np.flatnonzero(abs(coefficients - self._told) > CHANGE * self._told):
            name, properties = self._points[k]
            mu = half_of(float(coefficients[k]))
            properties.UpdateProperty("material", "coulomb_friction", coulomb(mu, mu))
            self._scene_graph.AssignRole(self._seen, source, name, properties, geometry.RoleAssign.kReplace)
            self._told[k] = coefficients[k]

    def step(self, wrench: tuple[float, float, float, float, float]) -> None:
        """Go on by one step under torque (3) and force (x, y) about the geometric centre, world axes."""
        self._forces[:5] = wrench
        self._plant.get_applied_generalized_force_input_port().FixValue(self._context, self._forces)
        self._steps += 1
        self._simulator.AdvanceTo(self._steps * self._step_s)

    def state(self) -> np.ndarray:
        """Return quaternion (4), place (3), further joints, angular velocity (3), velocity (3), further ones."""
        return self._plant.GetPositionsAndVelocities(self._context)

    @property
    def positions(self) -> int:
        """How many of a state's numbers come before its velocities."""
        return self._plant.num_positions()


def inertia_of(world: World, share: float) -> Any:
    """Return the spatial inertia about the geometric centre, of a share of the mass."""
    tree = drake("multibody.tree")
    hx, hy, hz = world.half_size
    mass = world.mass * share
    # of a box of uniform density; another yaw inertia scales all three, or no body could have it
    ratio = world.yaw_inertia / (world.mass * (hx * hx + hy * hy) / 3.0)
    third, hx2, hy2, hz2 = mass * ratio / 3.0, hx * hx, hy * hy, hz * hz
    central = tree.RotationalInertia(third * (hy2 + hz2), third * (hx2 + hz2), third * (hx2 + hy2))
    return tree.SpatialInertia.MakeFromCentralInertia(mass, np.array([*world.com, 0.0]), central)
