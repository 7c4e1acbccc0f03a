"""The body above its table as a `MultibodyPlant`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from runner.blind.drake_body.physics.points import points_of, rounding_of
from runner.blind.drake_body.physics.world import World
from runner.blind.drake_engine import drake, ground_material, half_of, material

TABLE_SHARE = 3.0  # mass of a table that gives, in masses of the body
RIGID_M = 2e-6  # what a table gives less than that it does not give


class BodyOnTable:
    """The plant, its context, and the force that is told to it.

    Contact is Drake's point contact of spheres at the corners, on linear springs with linear dampers, by its SAP. What
    keeps Coulomb's law in an impact to the letter (its continuous contact, `tamsi`) leaves the first touch otherwise
    than the convex contact of MuJoCo does, by several noises within a tenth of a second, whatever numbers the MJCF has:
    the owner of every recording would believe in contacts that no model of theirs can have.

    Args:
        world: What is simulated.
        step_s: Of the discrete plant.
    """

    def __init__(self, world: World, step_s: float) -> None:
        self._world, self._step_s, self._steps = world, step_s, 0
        multibody, builder = drake("multibody.plant"), drake("systems.framework").DiagramBuilder()
        config = multibody.MultibodyPlantConfig(
            time_step=step_s, discrete_contact_approximation="sap", contact_model="point"
        )
        self._plant, _ = multibody.AddMultibodyPlant(config, builder)
        x, y = math.tan(world.lean[0]), math.tan(world.lean[1])
        down = world.gravity * np.array([x, y, -1.0]) / math.sqrt(1.0 + x * x + y * y)
        self._plant.mutable_gravity_field().set_gravity_vector(down)
        self._body = self._plant.AddRigidBody("body", _inertia(world))
        self._add_points()
        self._add_table()
        if world.strange.loose_share > 0.0:
            self._add_loose_mass()
        self._plant.Finalize()
        self._diagram = builder.Build()
        self._simulator = drake("systems.analysis").Simulator(self._diagram)

    def _add_points(self) -> None:
        world, transform = self._world, drake("math").RigidTransform
        # the step takes the spring at its end, which damps it as a relaxation of one step does
        relaxation_s = max(world.relaxation_s - self._step_s, 0.0)
        properties = material(
            stiffness_n_per_m=world.stiffness_n_per_m, friction=half_of(world.friction), relaxation_s=relaxation_s
        )
        for k, (corner, outward, radius) in enumerate(zip(*points_of(world), rounding_of(world), strict=True)):
            ball = drake("geometry").Sphere(radius)
            at = transform(corner - radius * outward)
            self._plant.RegisterCollisionGeometry(self._body, at, ball, f"point_{k}", properties)

    def _add_table(self) -> None:
        tree, world, give_m = drake("multibody.tree"), self._world, self._world.strange.give_m
        table = self._plant.world_body()
        if give_m > RIGID_M:
            mass, stiffness = TABLE_SHARE * world.mass, world.mass * world.gravity / give_m
            inertia = tree.SpatialInertia(mass, np.zeros(3), tree.UnitInertia.SolidSphere(0.1))
            table = self._plant.AddRigidBody("table", inertia)
            damping = 0.4 * math.sqrt(stiffness * mass)
            slide = tree.PrismaticJoint(
                "table", self._plant.world_frame(), table.body_frame(), [0.0, 0.0, 1.0], damping=damping
            )
            joint = self._plant.AddJoint(slide)
            # at rest it is where it would be without giving
            self._plant.AddForceElement(tree.PrismaticSpring(joint, mass * world.gravity / stiffness, stiffness))
        self._plant.RegisterCollisionGeometry(
            table, drake("math").RigidTransform(), drake("geometry").HalfSpace(), "table",
            ground_material(relaxation_s=0.0),
        )  # fmt: skip

    def _add_loose_mass(self) -> None:
        tree, s = drake("multibody.tree"), self._world.strange
        mass = s.loose_share * self._world.mass
        stiffness = mass * (2.0 * math.pi * s.loose_hz) ** 2
        damping = 2.0 * s.loose_damping * math.sqrt(stiffness * mass)
        radius = 0.2 * min(self._world.half_size)
        parent = self._body
        for axis, share in (("x", 1e-3), ("y", 1e-3), ("z", 1.0)):
            ball = tree.SpatialInertia(share * mass, np.zeros(3), tree.UnitInertia.SolidSphere(radius))
            child = self._plant.AddRigidBody(f"loose_{axis}", ball)
            way = [float(axis == a) for a in "xyz"]
            slide = tree.PrismaticJoint(f"loose_{axis}", parent.body_frame(), child.body_frame(), way, damping=damping)
            self._plant.AddForceElement(tree.PrismaticSpring(self._plant.AddJoint(slide), 0.0, stiffness))
            parent = child

    def place(self, place: np.ndarray, quaternion: np.ndarray, spin: np.ndarray, velocity: np.ndarray) -> None:
        """Begin anew with the body there: (3,), w, x, y, z, and both velocities, world axes."""
        root = self._diagram.CreateDefaultContext()
        self._simulator.reset_context(root)
        self._context, self._steps = self._plant.GetMyMutableContextFromRoot(root), 0
        pose = drake("math").RigidTransform(drake("common.eigen_geometry").Quaternion(quaternion), place)
        self._plant.SetFreeBodyPose(self._context, self._body, pose)
        moving = drake("multibody.math").SpatialVelocity(spin, velocity)
        self._plant.SetFreeBodySpatialVelocity(self._context, self._body, moving)

    def push(self, wrench: np.ndarray) -> None:
        """Set torque (3) about the geometric centre and force (3), world axes, until they are set anew."""
        acting = drake("multibody.plant").ExternallyAppliedSpatialForce()
        acting.body_index, acting.p_BoBq_B = self._body.index(), np.zeros(3)
        acting.F_Bq_W = drake("multibody.math").SpatialForce(wrench[:3], wrench[3:])
        value = drake("common.value").Value[list[type(acting)]]([acting])  # ty: ignore[invalid-type-form]  # a key
        self._plant.get_applied_spatial_force_input_port().FixValue(self._context, value)

    def go(self, steps: int) -> None:
        """Go on by so many steps."""
        self._steps += steps
        self._simulator.AdvanceTo(self._steps * self._step_s)

    def state(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return place, turn (3, 3), spin and velocity, world axes."""
        pose = self._plant.EvalBodyPoseInWorld(self._context, self._body)
        moving: Any = self._plant.EvalBodySpatialVelocityInWorld(self._context, self._body)
        return pose.translation(), pose.rotation().matrix(), moving.rotational(), moving.translational()


def _inertia(world: World) -> Any:
    """Return the spatial inertia about the geometric centre, of what is not loose."""
    tree, share = drake("multibody.tree"), 1.0 - world.strange.loose_share
    central = tree.RotationalInertia(*(share * world.inertia * moment for moment in world.uniform_inertia))
    return tree.SpatialInertia.MakeFromCentralInertia(share * world.mass, np.array(world.com), central)
