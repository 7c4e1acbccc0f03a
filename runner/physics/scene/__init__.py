"""The scene: boxes on a frictional floor, built with dm-control's `mjcf`, stepped by dm-control's Physics.

Two choices span it. `dof`: `planar` moves in x, y and yaw (the constraint of the published experiment), `free` in all
six degrees of freedom. `contact`: `patch` spreads dry friction over the base by the compiled `dry_friction`,
`feet` carries the box on n x n small spheres, `corners` on its four corners.

MuJoCo's stock contact settings let a sliding box hop. The native contacts here use explicit pairs whose normal
direction is soft and direct (`solref` negative), and whose friction rows are hard (`impratio`), see `contact`.
"""

from __future__ import annotations

from runner.physics.scene.build import build, push_columns
from runner.physics.scene.compiled import Scene, compile_scene, set_inertial
from runner.physics.scene.config import (
    Base,
    BodyConfig,
    Dof,
    FloorContact,
    PinConfig,
    SceneConfig,
    box_inertia,
    check_inertia,
)
from runner.physics.scene.handle import BodyHandle, handles, rotate

__all__ = [
    "Base",
    "BodyConfig",
    "BodyHandle",
    "Dof",
    "FloorContact",
    "PinConfig",
    "Scene",
    "SceneConfig",
    "box_inertia",
    "build",
    "check_inertia",
    "compile_scene",
    "handles",
    "push_columns",
    "rotate",
    "set_inertial",
]
