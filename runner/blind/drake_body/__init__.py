"""Bodies in space by Drake: a cube, a box or a cylinder, tossed onto a table, let fall and slid over it.

The owner's model is an MJCF; the rigid body, its contact and the solver of the recorded world are Drake's.
"""
