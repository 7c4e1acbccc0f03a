"""Trees of hinges and slides that touch nothing, stepped without the engine around them.

numbers      what is taken of a compiled model, where that is all there is to it: `tree_of`
dynamics     positions, inertia and inertial forces of the tree
constraints  dry friction and limits, as soft as MuJoCo has them, solved exactly
rollout      the loop over motions and steps: `rollout`
"""

from runner.physics.joint_tree.numbers import Tree, tree_of
from runner.physics.joint_tree.rollout import rollout

__all__ = ["Tree", "rollout", "tree_of"]
