"""The closed loop: a remote cube, local cubes that follow it over a link, and estimators of what the remote is like.

Modules, in the order of their imports:

    frames, link, follow, estimators, parameters    what a run is told, and what it leaves
    experiment            an experiment as a value, and compiled
    latency               the local cubes simulated again from a late state
    run_record            raw numbers of a run
    local_side, late_side, sides    what is done at an update
    columns               frames from raw numbers
    loop, batch           one run on dm-control's physics, many on `mujoco.batch.Batch`
    sinks, tables         what is left on disk
"""
