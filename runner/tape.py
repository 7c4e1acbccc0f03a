"""The tape: commands played, and frames recorded, once per physics step, inside MuJoCo's step.

`physics.step(n)` takes n steps without a return to Python. So that commands still change from step to step, and
every step still leaves a frame, a numba function as MuJoCo's `mjcb_control` (called in each step after the law)
plays and records on a strip at the end of `mjData.userdata`. All of its state is there: several models in one
process, several threads, and `mujoco.batch.Batch` are safe, and models without a strip are left alone.

The strip, with b bodies, room for K steps, and frames of width w = nq + nv + b * law.OUT_SIZE:

    [(K + 1) * b * PUSH_SIZE commands | K * w frames | cursor, K, b, nq, nv, address of the strip, magic]

Row k of the commands is the push of every body in step k; row k of the frames is qpos and qvel at the start of step
k, then what the law said of each body in that step. The callback comes after the law has used command k, so it hands
command k + 1 to the next step; the last row is for the first step of the next strip. `Tape.wind` hands over the very
first command.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

import mujoco
import numpy as np
from dm_control import mjcf
from numba import carray, cfunc, types

from runner import law

MAGIC = 314159.2653
CONTROL_SIZE = 7
CURSOR, CAPACITY, BODIES, NQ, NV, ADDRESS, MAGIC_AT = range(-CONTROL_SIZE, 0)


@dataclass(frozen=True)
class Tape:
    """Where the strip of one model stands in `mjData.userdata`, for `bodies` bodies and up to `capacity` steps."""

    bodies: int
    capacity: int
    nq: int
    nv: int

    @property
    def command_width(self) -> int:
        """Numbers per step of commands: the pushes of all bodies, in the order of their blocks."""
        return self.bodies * law.PUSH_SIZE

    @property
    def frame_width(self) -> int:
        """Numbers per step of frames: qpos, qvel, and the law's output of each body."""
        return self.nq + self.nv + self.bodies * law.OUT_SIZE

    @property
    def address(self) -> int:
        """Start of the strip in userdata: it follows the law's blocks."""
        return self.bodies * law.USERDATA_SIZE

    @property
    def size(self) -> int:
        """Numbers that the strip takes in userdata."""
        return (self.capacity + 1) * self.command_width + self.capacity * self.frame_width + CONTROL_SIZE

    def commands(self, userdata: np.ndarray) -> np.ndarray:
        """Return the live view of the commands, (..., capacity + 1, command_width)."""
        end = self.address + (self.capacity + 1) * self.command_width
        return _rows(userdata[..., self.address : end], self.command_width)

    def frames(self, userdata: np.ndarray) -> np.ndarray:
        """Return the live view of the frames, (..., capacity, frame_width)."""
        start = self.address + (self.capacity + 1) * self.command_width
        return _rows(userdata[..., start : start + self.capacity * self.frame_width], self.frame_width)

    def cursor(self, userdata: np.ndarray) -> np.ndarray:
        """Return the live view of the cursor, (..., 1): set it to 0 before each strip."""
        return userdata[..., CURSOR : CURSOR + 1]

    def wind(self, userdata: np.ndarray, first: np.ndarray) -> None:
        """Switch the strip on: from now on every step of this data plays and records.

        Args:
            userdata: Of one data, (nuserdata,), or of many, (n, nuserdata).
            first: The command of the first step, (..., command_width).
        """
        blocks = _rows(userdata[..., : self.address], law.USERDATA_SIZE)
        blocks[..., : law.PUSH_SIZE] = first.reshape(*first.shape[:-1], self.bodies, law.PUSH_SIZE)
        userdata[..., -CONTROL_SIZE:] = (0, self.capacity, self.bodies, self.nq, self.nv, self.address, MAGIC)

    @staticmethod
    def unwind(userdata: np.ndarray) -> None:
        """Switch the strip off."""
        userdata[..., MAGIC_AT] = 0.0


def _rows(strip: np.ndarray, width: int) -> np.ndarray:
    """Fold the last axis into rows without a copy: the result is a live view."""
    shape = (*strip.shape[:-1], strip.shape[-1] // width, width)
    strides = (*strip.strides[:-1], width * strip.itemsize, strip.itemsize)
    return np.lib.stride_tricks.as_strided(strip, shape, strides)


def add(root: mjcf.RootElement, *, bodies: int, capacity: int) -> None:
    """Make room for a strip in a scene that is about to be compiled, and whose joints are all there."""
    install()
    tags = [joint.tag for joint in root.find_all("joint")]
    free, single = tags.count("freejoint"), tags.count("joint")
    tape = Tape(bodies, capacity, 7 * free + single, 6 * free + single)
    root.size.nuserdata = tape.address + tape.size


def _compile(o_nuserdata: int, o_userdata: int, o_qpos: int, o_qvel: int):  # noqa: ANN202
    push, out, stride = law.PUSH_SIZE, law.OUT_SIZE, law.USERDATA_SIZE

    @cfunc("void(uint64, uint64)", cache=True)
    def tape(m, d):  # noqa: ANN001, ANN202
        size = carray(law._as_pointer(types.uint64(m + o_nuserdata)), (1,), types.int64)[0]
        if size < CONTROL_SIZE:
            return
        user = law._load(d, o_userdata, size)
        if user[size - 1] != MAGIC:
            return
        cursor = int(user[size - 7])
        capacity = int(user[size - 6])
        if cursor >= capacity:
            return
        bodies, nq, nv = int(user[size - 5]), int(user[size - 4]), int(user[size - 3])
        commands = int(user[size - 2])
        width = nq + nv + bodies * out
        frame = commands + (capacity + 1) * bodies * push + cursor * width
        qpos = law._load(d, o_qpos, nq)
        qvel = law._load(d, o_qvel, nv)
        for i in range(nq):
            user[frame + i] = qpos[i]
        frame += nq
        for i in range(nv):
            user[frame + i] = qvel[i]
        frame += nv
        for b in range(bodies):
            for i in range(out):
                user[frame + b * out + i] = user[b * stride + push + i]
        cursor += 1
        user[size - 7] = cursor
        row = commands + cursor * bodies * push
        for b in range(bodies):
            for i in range(push):
                user[b * stride + i] = user[row + b * push + i]

    return tape


_INSTALLED: list[object] = []  # keeps the callback alive for as long as MuJoCo may call it


def install() -> None:
    """Give the tape to MuJoCo, once per process."""
    if _INSTALLED:
        return
    xml = """<mujoco><size nuserdata="6007"/><worldbody><body><joint/><geom size=".1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    m, d = model._address, data._address  # type: ignore[attr-defined]
    tape = _compile(
        law._find(m, 6007, 4000), *(law._find(d, getattr(data, n).ctypes.data) for n in ("userdata", "qpos", "qvel"))
    )
    callback = ctypes.CFUNCTYPE(None, ctypes.c_uint64, ctypes.c_uint64)(tape.address)
    _INSTALLED.extend([tape, callback])
    mujoco.set_mjcb_control(callback)
