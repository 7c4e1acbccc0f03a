"""What channels show of positions and velocities alone, and how that changes with them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from runner.numerics.arrays import FloatArray
from runner.recording.model_form_mapping import ChannelSource
from runner.systems.mechanism import quaternions
from runner.systems.mechanism.coordinates import FREE
from runner.systems.mechanism.models import OWN, Compiled
from runner.systems.mechanism.observer import ACCELERATION

DIFFERENCE = 1e-6
VELOCITY = int(mujoco.mjtStage.mjSTAGE_VEL)


@dataclass(frozen=True)
class _ByItself:
    """Channels of positions that are those of the model: of joints, and of bodies on free joints.

    Args:
        channels: Those of numbers that simply add.
        q: Where each of those stands among the positions.
        turns: Where each orientation does, by its first channel.
        jacobian: How they change with tangent coordinates, (C, nv): a one in each row.
    """

    channels: NDArray[np.intp]
    q: NDArray[np.intp]
    turns: Mapping[int, int]
    jacobian: FloatArray

    def turned(self, qpos: FloatArray) -> dict[int, FloatArray]:
        """Return orientations as quaternions, by their first channel."""
        return {k: qpos[q : q + 4] for k, q in self.turns.items()}


def _by_itself(
    sources: tuple[ChannelSource, ...], compiled: Compiled, positions: NDArray[np.bool_]
) -> _ByItself | None:
    """Return where positions that channels tell stand in those of a model; None: some are no coordinates of it."""
    model, coordinates = compiled.model, compiled.coordinates
    places, turns, jacobian = dict[int, int](), dict[int, int](), np.zeros((len(sources), coordinates.nv))
    for k, source in enumerate(sources):
        if not positions[k]:
            continue
        if source.kind == "joint":
            joint, index = coordinates.by_name[source.target], 0
        elif source.kind == "body" and (free := _free_joint(model, source.target)) is not None:
            joint, index = coordinates.joints[free], source.index
        else:
            return None
        turn = source.quantity == "orientation"
        jacobian[k, joint.v.start + index + 3 * turn] = 1.0
        if not turn:
            places[k] = joint.q.start + index
        elif index == 0:
            turns[k] = joint.q.start + 3
    return _ByItself(np.array([*places], dtype=int), np.array([*places.values()], dtype=int), turns, jacobian)


def _free_joint(model: mujoco.MjModel, body: str) -> int | None:
    joint = int(model.body(body).jntadr[0])
    return joint if joint >= 0 and int(model.jnt_type[joint]) == FREE else None


class Kinematics:
    """Channels as functions of a state of the believed model.

    Attributes:
        positions: Channels that tell of positions by themselves, (C,) bool.
        velocities: Channels that tell of velocities, (C,) bool; forces and accelerations tell of neither.
        turns: Where the three channels of an orientation begin, and their source.
    """

    def __init__(self, sources: tuple[ChannelSource, ...], compiled: Compiled) -> None:
        self._model, self._coordinates = compiled.model, compiled.coordinates
        self._data = mujoco.MjData(compiled.model)
        tells = [_tells(s, compiled.model) for s in sources]
        self.positions = np.array([t == "position" for t in tells])
        self.velocities = np.array([t == "velocity" for t in tells])
        self.turns = {k: s for k, s in enumerate(sources) if s.quantity == "orientation" and s.index == 0}
        joint = {k: compiled.coordinates.by_name[s.target] for k, s in enumerate(sources) if s.kind == "joint"}
        self._q = [(k, j.q.start) for k, j in joint.items() if self.positions[k]]
        self._v = [(k, j.v.start) for k, j in joint.items() if self.velocities[k]]
        sensed = [k for k, s in enumerate(sources) if s.kind in ("body", "sensor")]
        self._sensed = np.array(sensed, dtype=int)
        names = [s.target if s.kind == "sensor" else f"{OWN}{s.quantity}:{s.target}" for s in sources]
        self._address = np.array(
            [int(compiled.model.sensor(names[k]).adr[0]) + sources[k].index for k in sensed], dtype=int
        )
        self._quaternion = {k: int(compiled.model.sensor(names[k]).adr[0]) for k in self.turns}
        self._by_itself = _by_itself(sources, compiled, self.positions)
        # joints that are measured by themselves show the same whatever the position
        reference = np.array(compiled.model.qpos0)
        self._constant: tuple[FloatArray, FloatArray] | None = None
        if not sensed:
            self._constant = self._by_position(reference), self._by_velocity(reference)

    @property
    def is_constant(self) -> bool:
        """Whether what channels show changes by the same with positions and velocities everywhere."""
        return self._constant is not None

    def shown(self, qpos: FloatArray, qvel: FloatArray) -> tuple[FloatArray, dict[int, FloatArray]]:
        """Return what each channel shows, (C,), and orientations as quaternions by their first channel."""
        out = np.full(len(self.positions), np.nan)
        for k, q in self._q:
            out[k] = qpos[q]
        for k, v in self._v:
            out[k] = qvel[v]
        if not len(self._sensed):
            return out, {}
        data, model = self._data, self._model
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_sensorPos(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_sensorVel(model, data)
        out[self._sensed] = data.sensordata[self._address]
        return out, {k: np.array(data.sensordata[a : a + 4]) for k, a in self._quaternion.items()}

    def from_reference(self, qpos: FloatArray, reference: dict[int, FloatArray]) -> FloatArray:
        """Return what channels of positions show, (C,), orientations as turns from references; others are NaN."""
        if self._by_itself is None:
            out, turned = self.shown(qpos, np.zeros(self._coordinates.nv))
        else:
            out, turned = np.full(len(self.positions), np.nan), self._by_itself.turned(qpos)
            out[self._by_itself.channels] = qpos[self._by_itself.q]
        for k, q in turned.items():
            out[k : k + 3] = quaternions.logarithm(quaternions.multiply(quaternions.inverse(reference[k]), q))
        out[~self.positions] = np.nan
        return out

    def posed(self, shown: FloatArray, reference: dict[int, FloatArray]) -> FloatArray | None:
        """Return the one position (T, nq) that shows these channels, (T, C); None: not every coordinate is one of them.

        Args:
            shown: Orientations as turns from references; NaN where a channel tells of no position.
            reference: By the first channel of each orientation, (T, 4).
        """
        own, told = self._by_itself, shown[:, self.positions]
        if own is None or (own.jacobian.sum(axis=0) != 1).any() or not np.isfinite(told).all():
            return None
        out = np.empty((len(shown), self._coordinates.nq))
        out[:, own.q] = shown[:, own.channels]
        for k, q in own.turns.items():
            turned = quaternions.multiply(reference[k], quaternions.exponential(shown[:, k : k + 3]))
            out[:, q : q + 4] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        return out

    def jacobian(self, qpos: FloatArray) -> FloatArray:
        """Return how channels of positions change with positions, (C, nv); 0 for the others."""
        if self._by_itself is not None:
            return self._by_itself.jacobian
        return self._by_position(qpos) if self._constant is None else self._constant[0]

    def rate_jacobian(self, qpos: FloatArray) -> FloatArray:
        """Return how channels of velocities change with velocities, (C, nv); 0 for the others."""
        return self._by_velocity(qpos) if self._constant is None else self._constant[1]

    def _by_position(self, qpos: FloatArray) -> FloatArray:
        nv = self._coordinates.nv
        still, moved = np.zeros(nv), np.empty_like(qpos)
        base, turned = self.shown(qpos, still)
        out = np.zeros((len(base), nv))
        for i, unit in enumerate(np.eye(nv)):
            moved[:] = qpos
            mujoco.mj_integratePos(self._model, moved, unit, DIFFERENCE)
            there, later = self.shown(moved, still)
            out[self.positions, i] = (there - base)[self.positions] / DIFFERENCE
            for k, q in later.items():
                turn = quaternions.multiply(quaternions.inverse(turned[k]), q)
                out[k : k + 3, i] = quaternions.logarithm(turn) / DIFFERENCE
        return out

    def _by_velocity(self, qpos: FloatArray) -> FloatArray:
        nv = self._coordinates.nv
        base = self.shown(qpos, np.zeros(nv))[0]
        out = np.zeros((len(base), nv))
        if self.velocities.any():
            for i, unit in enumerate(np.eye(nv)):
                out[self.velocities, i] = (self.shown(qpos, unit)[0] - base)[self.velocities]
        return out


def _tells(source: ChannelSource, model: mujoco.MjModel) -> str:
    """Return what a channel tells of a state by itself: position | velocity | "" where it depends on forces."""
    if source.kind == "actuator":
        return ""
    if source.kind == "sensor":
        stage = int(model.sensor_needstage[model.sensor(source.target).id])
        return {ACCELERATION: "", VELOCITY: "velocity"}.get(stage, "position")
    return "velocity" if source.quantity in ("velocity", "angular_velocity") else "position"
