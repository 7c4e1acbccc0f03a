"""Who writes to a folder: the one process that holds it. What a killed one held is free at once."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import lock_descriptor

TRIES, PAUSE_S = 5, 0.02  # whoever only looks whether a folder is held, holds it for some microseconds


@contextmanager
def holding(folder: Path) -> Iterator[bool]:
    """Hold a folder, and tell whether that went; the folder itself is held, so that no lock file is left in it.

    Raises:
        OSError: If the folder can't be opened.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        held = lock_descriptor(handle, blocking=False)
        for _ in range(TRIES - 1):
            if held:
                break
            time.sleep(PAUSE_S)
            held = lock_descriptor(handle, blocking=False)
        yield held
    finally:
        os.close(handle)


def is_held(folder: Path) -> bool:
    """Tell whether a process holds a folder; one that can't be opened is held by none."""
    try:
        with holding(folder) as free:
            return not free
    except OSError:
        return False
