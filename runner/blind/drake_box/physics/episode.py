"""An episode of a scene, stepped by Drake from sample to sample."""

from __future__ import annotations

import math

import numpy as np

from runner.blind.drake_box.physics.base import NODES, base_of
from runner.blind.drake_box.physics.floor import Floor
from runner.blind.drake_box.physics.plant import BoxOnFloor
from runner.blind.drake_box.physics.push import pushed
from runner.blind.drake_box.physics.scene import Scene
from runner.blind.drake_box.physics.surroundings import Surroundings
from runner.blind.planar_box.physics import PlannedEpisode
from runner.errors import RunnerError

STEP_S = 1.0 / 240.0  # the longest
TIPPED = 0.05  # sine of the lean beyond which the box has left its base
STILL = 1e-7  # m/s and rad/s


class DrakeError(RunnerError):
    """The engine could not go on, or the box has left the floor."""


def simulate(scene: Scene, episode: PlannedEpisode, *, step_s: float = STEP_S, nodes: int = NODES) -> np.ndarray:
    """Return `simulate_all` of one episode."""
    return simulate_all(scene, [episode], step_s=step_s, nodes=nodes)[0]


def simulate_all(
    scene: Scene, episodes: list[PlannedEpisode], *, step_s: float = STEP_S, nodes: int = NODES
) -> list[np.ndarray]:
    """Return the state that the sensor shows at every sample of each episode, without noise, shape (n, 6) each.

    Args:
        scene: One world.
        episodes: Start states and commands, all of one rate.
        step_s: Longest step of the plant; the time between samples is a whole number of steps.
        nodes: Points of the base per side.

    Raises:
        ConfigError: If Drake is not installed.
        DrakeError: If the engine gives up, or the box tips.
    """
    base = base_of(scene.world, nodes)
    substeps = math.ceil(1.0 / (episodes[0].rate_hz * step_s) - 1e-6)
    box = BoxOnFloor(scene, base, 1.0 / (episodes[0].rate_hz * substeps))
    floor, surroundings = Floor(scene, base), Surroundings(scene)
    try:
        return [_run(scene, episode, box, floor, surroundings, substeps) for episode in episodes]
    except RuntimeError as error:  # what the engine throws
        raise DrakeError(f"physics: Drake stopped: {str(error).splitlines()[0]}") from None


def _run(
    scene: Scene, episode: PlannedEpisode, box: BoxOnFloor, floor: Floor, surroundings: Surroundings, substeps: int
) -> np.ndarray:
    """Step from sample to sample.

    Drake's discrete step takes the velocity first and the place with the new one. So a place of its is read as that of
    half a step later, as in the leapfrog method, which is of second order where this would be of first.
    """
    world, step_s = scene.world, 1.0 / (episode.rate_hz * substeps)
    steps = (len(episode.command) - 1) * substeps
    push = pushed(scene, episode, steps, step_s).tolist()
    start = np.array(episode.start, float)
    start[[0, 1, 3, 4]] /= world.sensor_scale
    ahead = start.copy()
    ahead[:3] += 0.5 * step_s * start[3:]
    floor.begin()
    box.place(ahead)
    shown = np.empty((len(episode.command), 6))
    shown[0] = start
    settled = world.mass_leak == 0.0 and not floor.restless
    yaw, last, still = float(ahead[2]), None, False
    place, twist = (ahead[0], ahead[1], yaw), (start[3], start[4], start[5])
    for k in range(steps):
        t = k * step_s
        wrench = surroundings.wrench(push[k], place, twist, t, episode.duration_s)
        if not (still and wrench == last):
            if world.mass_leak != 0.0 and k % substeps == 0:
                box.lighten(1.0 - world.mass_leak * t)
            if not floor.uniform and k % floor.every == 0:
                box.rub(floor.coefficients(place, twist, episode.elapsed_s + t, step_s))
            box.step(wrench)
            state, velocity = box.state(), box.positions
            lean = math.hypot(state[1], state[2])  # of the quaternion: half the sine
            if not lean < 0.5 * TIPPED:
                raise DrakeError(f"physics: the box tips at {t:.3f} s.")
            turned = 2.0 * math.atan2(state[3], state[0])
            yaw = turned + 2.0 * math.pi * round((yaw - turned) / (2.0 * math.pi))
            place = float(state[4]), float(state[5]), yaw
            twist = float(state[velocity + 3]), float(state[velocity + 4]), float(state[velocity + 2])
            still = settled and bool(np.max(np.abs(state[velocity:])) < STILL)
        last = wrench
        if (k + 1) % substeps == 0:
            row = np.array([*place, *twist])
            row[:3] -= 0.5 * step_s * row[3:]
            shown[(k + 1) // substeps] = row
    shown[:, [0, 1, 3, 4]] *= world.sensor_scale
    return shown
