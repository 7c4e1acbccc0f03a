"""What the law of joints knows of a joint: numbers in the joint's `user` data, after those of the model's owner.

`reserve(spec)` makes room before compiling. In the compiled model all of them are zero, and then the law leaves the
joint alone: whoever writes nominal numbers back writes `jnt_user` as it was compiled.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco

from runner.physics.joint_law import written_law

MAGIC = 314159.2653

FIELDS = ("magic", *written_law.FIELDS)  # which says what each of them means
SIZE = len(FIELDS)
COLUMN = {name: i for i, name in enumerate(FIELDS)}


def reserve(spec: mujoco.MjSpec) -> None:
    """Make room for the law in a model that is yet to be compiled; for `user` data of the owner's, too."""
    own = max((len(joint.userdata) for joint in spec.joints), default=0)
    spec.nuser_jnt = max(spec.nuser_jnt, own) + SIZE


@dataclass(frozen=True)
class JointLaw:
    """Read and write access to the law of one hinge or slide inside a compiled model, by field name."""

    model: mujoco.MjModel = field(repr=False)
    joint: int

    def __post_init__(self) -> None:
        if self.model.nuser_jnt < SIZE:
            raise ValueError("The model has no room for the law of joints: call `reserve` before it is compiled.")

    @property
    def present(self) -> bool:
        """Whether the law does anything with the joint."""
        return self["magic"] == MAGIC

    def __getitem__(self, name: str) -> float:
        return float(self.model.jnt_user[self.joint, COLUMN[name] - SIZE])

    def __setitem__(self, name: str, value: float) -> None:
        row = self.model.jnt_user[self.joint]
        row[COLUMN[name] - SIZE] = value
        row[COLUMN["magic"] - SIZE] = MAGIC
