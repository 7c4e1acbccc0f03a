"""Estimation in space: mass, centre of mass and inertia of a body that is held and shaken, or flies.

tracker = SpaceEstimator(sensors).tracker(half_size_m, step_s, noise, gravity)
belief = tracker.start(SpacePrior(to_vector(body, half_size_m)), first)    # readings of N lanes side by side
belief = tracker.update(belief, reading)                                   # one step later
values, covariance = tracker.values(belief)                                # (N, 10), (N, 10, 10), see `inertial.NAMES`
"""
