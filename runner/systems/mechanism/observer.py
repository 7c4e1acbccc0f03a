"""From simulated states to what the channels show.

What a joint does is read from the states, and so is the pose of a body with a free joint. An actuator's force that is a
linear function of command, position and velocity is computed from them; everything else (poses of other bodies, sensors
of the MJCF, forces of other actuators) is read from MuJoCo's sensors, evaluated in one further step from each state, as
those that come with a simulation mix positions and velocities of different instants.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from runner.numerics.arrays import FloatArray
from runner.recording.model_form import MechanismEpisode, MechanismRecording
from runner.recording.model_form_mapping import AFFINE_BIAS, AT_JOINT, NO_BIAS, ChannelSource
from runner.systems.mechanism import quaternions
from runner.systems.mechanism.models import OWN, Compiled

FIXED_GAIN, AFFINE_GAIN = int(mujoco.mjtGain.mjGAIN_FIXED), int(mujoco.mjtGain.mjGAIN_AFFINE)
NO_DYNAMICS = int(mujoco.mjtDyn.mjDYN_NONE)
ACCELERATION = int(mujoco.mjtStage.mjSTAGE_ACC)


@dataclass(frozen=True)
class States:
    """Simulated motion on a grid: positions (R, n, nq), velocities (R, n, nv), commands (R, n, nu) from there on."""

    position: FloatArray
    velocity: FloatArray
    command: FloatArray


class Observer:
    """Reads the channels of a recording from the states of one compiled model."""

    def __init__(self, recording: MechanismRecording, compiled: Compiled) -> None:
        self._sources = recording.mapping.sources
        self._compiled = compiled
        model = compiled.model
        self._from_sensors = {s.name: a for s in self._sources if (a := _sensor_address(s, model)) is not None}

    @property
    def needs_sensors(self) -> bool:
        """Whether sensor data must be given."""
        return bool(self._from_sensors)

    def channels(
        self, models: Sequence[mujoco.MjModel], states: States, sensordata: FloatArray | None
    ) -> dict[str, FloatArray]:
        """Return each channel by name on the grid, (R, n); orientations as quaternions by column, (R, n, 4).

        Args:
            models: Of each run.
            states: Of each run.
            sensordata: In those states, (R, n, nsensordata), where it is needed.
        """
        out = {}
        for source in self._sources:
            if source.kind == "joint":
                joint = self._compiled.coordinates.by_name[source.target]
                velocity = source.quantity == "velocity"
                out[source.name] = (states.velocity[..., joint.v] if velocity else states.position[..., joint.q])[
                    ..., 0
                ]
            elif source.kind == "body" and source.name not in self._from_sensors:
                out |= self._free(source, states)
            elif source.name not in self._from_sensors:
                out[source.name] = self._force(source.target, models, states)
            elif source.quantity == "orientation":
                assert sensordata is not None
                address = self._from_sensors[source.name]
                out[source.column] = sensordata[..., address : address + 4]
            else:
                assert sensordata is not None
                out[source.name] = sensordata[..., self._from_sensors[source.name] + source.index]
        return out

    def _free(self, source: ChannelSource, states: States) -> dict[str, FloatArray]:
        """Return one channel of a body with a free joint: its joint's own numbers, turning in the world's axes."""
        joint = self._compiled.coordinates.by_name[free_joint(self._compiled.model, source.target)]
        place, turn = states.position[..., joint.q][..., :3], states.position[..., joint.q][..., 3:]
        if source.quantity == "orientation":
            return {source.column: turn}
        if source.quantity == "position":
            return {source.name: place[..., source.index]}
        if source.quantity == "velocity":
            return {source.name: states.velocity[..., joint.v.start + source.index]}
        spin = np.concatenate([np.zeros_like(turn[..., :1]), states.velocity[..., joint.v][..., 3:]], axis=-1)
        world = quaternions.multiply(quaternions.multiply(turn, spin), quaternions.inverse(turn))
        return {source.name: world[..., 1 + source.index]}

    def _force(self, actuator: str, models: Sequence[mujoco.MjModel], states: States) -> FloatArray:
        """Return what a linear actuator exerts, (R, n)."""
        out = np.empty(states.position.shape[:2])
        for r, model in enumerate(models):
            a = model.actuator(actuator).id
            joint = int(model.actuator_trnid[a, 0])
            gear = model.actuator_gear[a, 0]
            length = gear * states.position[r, :, model.jnt_qposadr[joint]]
            speed = gear * states.velocity[r, :, model.jnt_dofadr[joint]]
            command = states.command[r, :, a]
            if model.actuator_ctrllimited[a]:
                command = np.clip(command, *model.actuator_ctrlrange[a])
            gain, bias = model.actuator_gainprm[a], model.actuator_biasprm[a]
            factor = gain[0] + (
                gain[1] * length + gain[2] * speed if int(model.actuator_gaintype[a]) == AFFINE_GAIN else 0.0
            )
            force = factor * command
            if int(model.actuator_biastype[a]) == AFFINE_BIAS:
                force = force + bias[0] + bias[1] * length + bias[2] * speed
            if model.actuator_forcelimited[a]:
                force = np.clip(force, *model.actuator_forcerange[a])
            out[r] = force
        return out


def held_channels(recording: MechanismRecording, model: mujoco.MjModel) -> frozenset[str]:
    """Return the channels that jump with the command: forces and accelerations."""
    out = []
    for s in recording.mapping.sources:
        sensor = s.kind == "sensor" and int(model.sensor_needstage[model.sensor(s.target).id]) == ACCELERATION
        if s.quantity == "force" or sensor:
            out.append(s.name)
    return frozenset(out)


def _sensor_address(source: ChannelSource, model: mujoco.MjModel) -> int | None:
    """Return where a channel begins among the sensor data; None: it is read from the states."""
    if source.kind == "joint" or (source.kind == "actuator" and _is_linear(model, source.target)):
        return None
    if source.kind == "body" and free_joint(model, source.target):
        return None
    name = {
        "actuator": f"{OWN}force:{source.target}",
        "body": f"{OWN}{source.quantity}:{source.target}",
        "sensor": source.target,
    }[source.kind]
    return int(model.sensor(name).adr[0])


def free_joint(model: mujoco.MjModel, body: str) -> str:
    """Return the name of the free joint that a body has of its own, "" without one."""
    first, count = int(model.body(body).jntadr[0]), int(model.body(body).jntnum[0])
    own = [j for j in range(first, first + count) if int(model.jnt_type[j]) == int(mujoco.mjtJoint.mjJNT_FREE)]
    return model.joint(own[0]).name if own else ""


def _is_linear(model: mujoco.MjModel, name: str) -> bool:
    """Whether an actuator's force is a linear function of command, position and velocity of one joint."""
    a = model.actuator(name).id
    return (
        int(model.actuator_trntype[a]) in AT_JOINT
        and int(model.jnt_type[model.actuator_trnid[a, 0]]) >= int(mujoco.mjtJoint.mjJNT_SLIDE)
        and int(model.actuator_gaintype[a]) in (FIXED_GAIN, AFFINE_GAIN)
        and int(model.actuator_biastype[a]) in (NO_BIAS, AFFINE_BIAS)
        and int(model.actuator_dyntype[a]) == NO_DYNAMICS
        and float(model.actuator_delay[a]) == 0.0
    )


class Sampling:
    """Reads channels that are known on a grid of physics steps at the times of samples.

    Args:
        grid_s: Times of the grid, (n,), even.
        at_s: Times of the samples, (T,), within the grid.
    """

    def __init__(self, grid_s: FloatArray, at_s: FloatArray) -> None:
        step = grid_s[1] - grid_s[0]
        place = (at_s - grid_s[0]) / step
        near = np.round(place)
        self._on_grid = bool(np.all(np.abs(place - near) < 1e-6))
        last = len(grid_s) - 1
        self._nearest = np.clip(near.astype(int), 0, last)
        self._next = np.clip(np.ceil(place - 1e-6).astype(int), 0, last)
        self._first = np.clip(np.floor(place).astype(int), 0, max(last - 1, 0))
        self._share = place - self._first
        self._last = last

    def smooth(self, values: FloatArray) -> FloatArray:
        """Return channels (..., n) without jumps at the samples, (..., T): cubics through four neighbours."""
        if self._on_grid:
            return values[..., self._nearest]
        k, s = self._first, self._share
        p0, p1 = values[..., k], values[..., np.minimum(k + 1, self._last)]
        before, after = values[..., np.maximum(k - 1, 0)], values[..., np.minimum(k + 2, self._last)]
        m0 = np.where(k > 0, 0.5 * (p1 - before), p1 - p0)
        m1 = np.where(k + 2 <= self._last, 0.5 * (after - p0), p1 - p0)
        a, b = s * s * (3 - 2 * s), s * (1 - s)
        return p0 + a * (p1 - p0) + b * ((1 - s) * m0 - s * m1)

    def held(self, values: FloatArray) -> FloatArray:
        """Return channels (..., n) that jump with the command just after each sample, (..., T)."""
        return values[..., self._next]


def turns_from(reference: FloatArray, orientation: FloatArray) -> FloatArray:
    """Return orientations (..., n, 4) as continuous rotation vectors (..., n, 3) from a reference (4,), its axes."""
    return quaternions.continuous(
        quaternions.logarithm(quaternions.multiply(quaternions.inverse(reference), orientation))
    )


def first_orientation(episode: MechanismEpisode, column: str) -> FloatArray:
    """Return the first measured orientation of an episode, (4,)."""
    measured = episode.orientations[column]
    return measured[int(np.argmax(np.isfinite(measured[:, 0])))]
