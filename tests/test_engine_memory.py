"""Fields of a struct are found by their values."""

from __future__ import annotations

import ctypes
import platform

import mujoco
import pytest

from runner.physics.engine_memory import DATA_BYTES, MODEL_BYTES, offset_of


def test_a_field_is_found_by_its_value() -> None:
    """The offset is that of the value, as a double or as 64 bits; one that is not there is refused."""
    raw = (ctypes.c_double * 4)(1.5, 2.5, 3.5, 4.5)
    address = ctypes.addressof(raw)
    assert offset_of(address, 3.5, size=32) == 16
    whole = (ctypes.c_uint64 * 3)(11, 22, 33)
    assert offset_of(ctypes.addressof(whole), 33, size=24) == 16
    with pytest.raises(RuntimeError, match=r"pin mujoco==3\.17\.0"):
        offset_of(address, 9.5, size=32)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="asks the allocator of glibc")
def test_nothing_beyond_a_struct_is_searched() -> None:
    """What is looked at was allocated for the struct: beyond it an address may stand that is of no field."""
    size_of = ctypes.CDLL(None).malloc_usable_size
    size_of.argtypes, size_of.restype = [ctypes.c_void_p], ctypes.c_size_t
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data = mujoco.MjData(model)
    assert MODEL_BYTES <= size_of(model._address) < MODEL_BYTES + 100
    assert DATA_BYTES <= size_of(data._address) < DATA_BYTES + 100
