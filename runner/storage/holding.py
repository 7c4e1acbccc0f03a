"""Who writes to a folder or a file: the one process that holds it. What a killed one held is free at once.

Only a descriptor is locked, which closing it frees: filelock's `FileLock` keeps books of its own, and a signal that
comes while it lets go of a file leaves them wrong, of which it then speaks in an error of its own.
"""

from __future__ import annotations

import os
import time
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from filelock import lock_descriptor

TRIES, PAUSE_S = 5, 0.02  # whoever only looks whether a folder is held, holds it for some microseconds


@contextmanager
def holding(path: Path, *, wait: bool = False) -> Generator[bool]:
    """Hold a folder or a file, and tell whether that went; it is held itself, so that no lock file is left beside it.

    Args:
        path: Of what exists.
        wait: Until whoever holds it lets go of it.

    Raises:
        OSError: If it can't be opened.
    """
    handle = os.open(path, os.O_RDONLY)
    try:
        held = lock_descriptor(handle, blocking=wait)
        for _ in range(TRIES - 1):
            if held:
                break
            time.sleep(PAUSE_S)
            held = lock_descriptor(handle, blocking=False)
        yield held
    finally:
        os.close(handle)


def is_held(path: Path) -> bool:
    """Tell whether a process holds a folder or a file; one that can't be opened is held by none."""
    try:
        with holding(path) as free:
            return not free
    except OSError:
        return False
