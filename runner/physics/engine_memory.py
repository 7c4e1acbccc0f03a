"""MuJoCo's memory, as the compiled callbacks see it: C structs at an address, whose fields lie at measured offsets.

A callback that runs inside MuJoCo's step gets the addresses of `mjModel` and `mjData` alone. Where their fields lie is
measured on a small model of known numbers (`offset_of`), so no header is needed; the compiled functions here then read
them.
"""

from __future__ import annotations

import ctypes
from pathlib import Path
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from numba import carray, njit, types
from numba.core import cgutils
from numba.extending import intrinsic

BIG = 1 << 30  # the length of arrays whose length does not matter
# Sizes of the structs of the pinned MuJoCo, as they are allocated at least: beyond lies others' memory, where
# the address of an array may stand too (numpy's own record of it).
MODEL_BYTES, DATA_BYTES = 5_704, 162_120


def load_engine() -> None:
    """Let compiled code call MuJoCo's functions by their names."""
    folder = Path(mujoco.__file__).parent
    llvmlite.binding.load_library_permanently(str(next(folder.glob("libmujoco*.so*"), folder / "mujoco.dll")))


def offset_of(address: int, wanted: int | float, size: int = DATA_BYTES) -> int:
    """Return the byte offset of a struct's field from a value that nothing else there has.

    Args:
        address: Of the struct.
        wanted: The value; a float is sought as a double, an int as 64 bits.
        size: How far to look, bytes.

    Raises:
        RuntimeError: If it is not there: another build of MuJoCo than the pinned one.
    """
    kind = ctypes.c_double if isinstance(wanted, float) else ctypes.c_uint64
    raw = (kind * (size // 8)).from_address(address)
    for i in range(size // 8):
        if raw[i] == wanted:
            return 8 * i
    raise RuntimeError(
        f"mujoco {mujoco.__version__}: a field that the compiled callbacks need was not found; pin mujoco==3.17.0."
    )


def offset_of_array(address: int, array: np.ndarray, size: int) -> int:
    """Return where a struct of `size` bytes points to an array.

    That is the last of equal pointers: arrays that are empty, which stand before, point to where the next one begins.
    """
    raw = np.ctypeslib.as_array((ctypes.c_uint64 * (size // 8)).from_address(address))
    hits = np.flatnonzero(raw == array.ctypes.data)
    if not len(hits):
        raise RuntimeError(f"mujoco {mujoco.__version__}: an array was not found; pin mujoco==3.17.0.")
    return 8 * int(hits[-1])


def _cast(typing_context, address):
    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], cgutils.voidptr_t)

    return types.voidptr(types.uint64), codegen


as_pointer: Any = intrinsic(_cast)


@njit(error_model="numpy")
def doubles(base, offset, size):
    """Return the array (size,) of float64 that the pointer at base + offset points to."""
    pointer = carray(as_pointer(types.uint64(base + offset)), (1,), types.uint64)
    return carray(as_pointer(pointer[0]), (size,), types.float64)


@njit(error_model="numpy")
def ints(base, offset, size):
    """Return the array (size,) of int32 that the pointer at base + offset points to."""
    pointer = carray(as_pointer(types.uint64(base + offset)), (1,), types.uint64)
    return carray(as_pointer(pointer[0]), (size,), types.int32)


@njit(error_model="numpy")
def double(base, offset):
    """Return the float64 at base + offset."""
    return carray(as_pointer(types.uint64(base + offset)), (1,), types.float64)[0]


@njit(error_model="numpy")
def integer(base, offset):
    """Return the int64 at base + offset."""
    return carray(as_pointer(types.uint64(base + offset)), (1,), types.int64)[0]
