"""MuJoCo's one passive callback, shared by the compiled laws: it calls every law that was installed, in that order.

`mjcb_passive` is global to a process, yet models of different kinds live side by side: each law recognises its own by
the numbers that stand in them, and leaves the others alone. All of it is machine code: it runs in `mj_step`, `rollout`
and `Batch` without Python and without the interpreter lock.
"""

from __future__ import annotations

import ctypes
from typing import Any

import llvmlite.binding
import mujoco
from numba import cfunc, types

# in `o_margin`, which counts for nothing unless contacts are overridden: steps of this model are to be of second order
SECOND_ORDER = 0.00027182818284
FREE_BODIES = 0.00031415926535  # the same of a model all of whose joints are free
SIGNATURE = types.void(types.uint64, types.uint64)
_LAWS: list[Any] = []
_INSTALLED: list[Any] = []  # keeps what MuJoCo may call alive


def install(law: Any) -> None:
    """Let MuJoCo call a law, a numba `cfunc` of the addresses of mjModel and mjData, besides those that it calls."""
    _LAWS.append(law)
    address = law.address
    if len(_LAWS) > 1:
        before = f"runner_passive_before_{len(_LAWS)}"
        llvmlite.binding.add_symbol(before, _INSTALLED[-1][0])
        llvmlite.binding.add_symbol(f"{before}_next", address)
        both = _one_after_the_other(before, f"{before}_next")
        _LAWS.append(both)
        address = both.address
    callback = ctypes.CFUNCTYPE(None, ctypes.c_uint64, ctypes.c_uint64)(address)
    _INSTALLED.append((address, callback))
    mujoco.set_mjcb_passive(callback)


def _one_after_the_other(first_symbol: str, second_symbol: str) -> Any:
    first = types.ExternalFunction(first_symbol, SIGNATURE)
    second = types.ExternalFunction(second_symbol, SIGNATURE)

    @cfunc(SIGNATURE)
    def both(m, d):
        first(m, d)
        second(m, d)

    return both
