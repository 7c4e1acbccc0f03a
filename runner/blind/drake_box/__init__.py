"""A second world of boxes, by somebody else's engine: the same cases as `planar_box`, simulated by Drake.

Our own second physics and the simulator of a diagnosis were written in one house. Here the rigid body, the contact and
its solver are Drake's; the pushes, the roughness of the world and what lies outside the vocabulary are others too.
"""
