"""The compiled law of joints: friction and forces that MuJoCo's joints lack, inside its step.

record       the numbers of the law in a compiled model, by joint: `reserve`, `JointLaw`
law          what it says of one joint, in compiled functions
binding      its place in MuJoCo: `install`
written_law  the law for plain MuJoCo, in Python: what is written beside a corrected model
"""

from runner.physics.joint_law.binding import install
from runner.physics.joint_law.record import SIZE, JointLaw, reserve

__all__ = ["SIZE", "JointLaw", "install", "reserve"]
