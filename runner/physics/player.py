"""The player: commands played, and frames recorded, once per physics step, inside MuJoCo's step.

`physics.step(n)` takes n steps without a return to Python. So that commands still change from step to step, and
every step still leaves a frame, a numba function as MuJoCo's `mjcb_control` (called in each step after dry friction)
plays from one array and records into another. Which arrays, and how far it has come, stands at the end of
`mjData.userdata`: several models in one process, several threads, and `mujoco.batch.Batch` are safe, and models
without a player are left alone.

With b bodies and n steps, `commands` is (n + 1, b * PUSH_SIZE): row k holds the pushes of all bodies in step k, and
the last is for a step that does not come. `frames` is (n, w), w = nq + nv + b * OUT_SIZE: row k holds qpos and qvel
at the start of step k, then what friction said of each body in that step. The callback comes after friction has used
command k, so it hands command k + 1 to the next step. After n steps it does nothing.

The arrays are known by their addresses alone. `Player.start` gives a `Playback`, which keeps them alive and must be
stopped before the data is stepped for anything else.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np
from dm_control import mjcf
from numba import carray, cfunc, types

from runner.physics import dry_friction, engine_memory
from runner.physics.engine_memory import as_pointer, doubles, integer, offset_of
from runner.storage.numba_cache import fingerprint

MAGIC = 314159.2653
SIZE = 8  # of the player's numbers in userdata: these, counted from the end
_STEP, _STEPS, _BODIES, _NQ, _NV, _COMMANDS, _FRAMES, _MAGIC = range(-SIZE, 0)


@dataclass(frozen=True)
class Player:
    """Plays and records in a model with `bodies` bodies that have a friction record."""

    bodies: int
    nq: int
    nv: int

    @property
    def command_width(self) -> int:
        """Numbers per step of commands."""
        return self.bodies * dry_friction.PUSH_SIZE

    @property
    def frame_width(self) -> int:
        """Numbers per step of frames."""
        return self.nq + self.nv + self.bodies * dry_friction.OUT_SIZE

    def start(self, userdata: np.ndarray, commands: np.ndarray) -> Playback:
        """Switch it on: from now on every step of this data plays and records.

        Args:
            userdata: Live, (nuserdata,).
            commands: (n + 1, command_width), C-contiguous, float64.
        """
        steps = len(commands) - 1
        if commands.shape[1] != self.command_width or commands.dtype != float or not commands.flags.c_contiguous:
            raise ValueError(f"commands must be C-contiguous float64 of width {self.command_width}: {commands.shape}")
        frames = np.empty((steps, self.frame_width))
        for body in range(self.bodies):
            at = body * dry_friction.USERDATA_SIZE
            userdata[at : at + dry_friction.PUSH_SIZE] = commands[
                0, body * dry_friction.PUSH_SIZE : (body + 1) * dry_friction.PUSH_SIZE
            ]
        # an address is an integer below 2^53, which a float64 holds exactly
        addresses = commands.ctypes.data, frames.ctypes.data
        userdata[-SIZE:] = (0, steps, self.bodies, self.nq, self.nv, *addresses, MAGIC)
        return Playback(userdata, commands, frames)


@dataclass(frozen=True)
class Playback:
    """A player that is switched on. `frames` is filled as the steps are taken."""

    userdata: np.ndarray
    commands: np.ndarray
    frames: np.ndarray

    def go_to(self, step: int) -> None:
        """Play and record from this step on; what was recorded after it is overwritten as steps are taken."""
        row = self.commands[step]
        for body in range(len(row) // dry_friction.PUSH_SIZE):
            at = body * dry_friction.USERDATA_SIZE
            self.userdata[at : at + dry_friction.PUSH_SIZE] = row[
                body * dry_friction.PUSH_SIZE : (body + 1) * dry_friction.PUSH_SIZE
            ]
        self.userdata[_STEP] = step

    def stop(self) -> None:
        """Switch the player off."""
        self.userdata[-SIZE:] = 0.0


def add(root: mjcf.RootElement, *, bodies: int) -> None:
    """Make room for a player in a scene that is about to be compiled."""
    install()
    root.size.nuserdata = bodies * dry_friction.USERDATA_SIZE + SIZE


class PlayerOffsets(NamedTuple):
    """Where this build of MuJoCo keeps what the callback reads, bytes from the start of `mjModel` or `mjData`."""

    nuserdata: int
    userdata: int
    qpos: int
    qvel: int
    sources: int  # no offset: `fingerprint` of what the callback is compiled from besides this file


def _compile(at: PlayerOffsets):
    """Compile the callback for these offsets. They stand in its closure, so that numba's cache tells builds apart."""
    push, out, stride = dry_friction.PUSH_SIZE, dry_friction.OUT_SIZE, dry_friction.USERDATA_SIZE

    @cfunc("void(uint64, uint64)", cache=True)
    def play(m, d):
        size = integer(m, at.nuserdata)
        if size < SIZE:
            return
        user = doubles(d, at.userdata, size)
        if user[size - 1] != MAGIC:
            return
        step, steps = int(user[size - 8]), int(user[size - 7])
        if step >= steps:
            return
        bodies, nq, nv = int(user[size - 6]), int(user[size - 5]), int(user[size - 4])
        width = nq + nv + bodies * out
        this_frame = types.uint64(user[size - 2]) + types.uint64(8 * width * step)
        frame = carray(as_pointer(this_frame), width, types.float64)
        next_command = types.uint64(user[size - 3]) + types.uint64(8 * push * bodies * (step + 1))
        command = carray(as_pointer(next_command), push * bodies, types.float64)
        qpos = doubles(d, at.qpos, nq)
        qvel = doubles(d, at.qvel, nv)
        for i in range(nq):
            frame[i] = qpos[i]
        for i in range(nv):
            frame[nq + i] = qvel[i]
        for b in range(bodies):
            for i in range(out):
                frame[nq + nv + b * out + i] = user[b * stride + push + i]
            for i in range(push):
                user[b * stride + i] = command[b * push + i]
        user[size - 8] = step + 1

    return play


_INSTALLED: list[object] = []  # keeps the callback alive for as long as MuJoCo may call it


def install() -> None:
    """Give the player to MuJoCo, once per process."""
    if _INSTALLED:
        return
    xml = """<mujoco><size nuserdata="6007"/><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    m, d = model._address, data._address
    compiled = _compile(
        PlayerOffsets(
            nuserdata=offset_of(m, 6007, 4000),
            userdata=offset_of(d, data.userdata.ctypes.data),
            qpos=offset_of(d, data.qpos.ctypes.data),
            qvel=offset_of(d, data.qvel.ctypes.data),
            sources=fingerprint(engine_memory.__file__),
        )
    )
    callback = ctypes.CFUNCTYPE(None, ctypes.c_uint64, ctypes.c_uint64)(compiled.address)
    _INSTALLED.extend([compiled, callback])
    mujoco.set_mjcb_control(callback)
