"""Processes that work for this one and end with it.

They take no notice of Ctrl-C, which reaches all processes of a terminal, and are killed by the kernel when their parent
ends, however it ends.
"""

from __future__ import annotations

import ctypes
import os
import pickle
import signal
import sys
from collections.abc import Generator
from contextlib import contextmanager
from multiprocessing import active_children
from typing import Any

PR_SET_PDEATHSIG = 1


def kill_workers() -> None:
    """End the processes that this one has started for its work; what they had not finished is done on going on."""
    for child in active_children():
        child.kill()


@contextmanager
def shielded() -> Generator[None]:
    """Start processes that Ctrl-C does not reach, from their first instruction: they inherit what is blocked here."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def joblib_workers() -> dict[str, Any]:
    """Return joblib's settings for workers that end with this process."""
    return {"initializer": end_with_parent, "initargs": (os.getpid(),)}


def worker_of(parent: int, *begin: bytes) -> None:
    """Begin a worker: see to its end before anything of size is imported, which takes seconds.

    Args:
        parent: Process id of the parent.
        begin: Functions with their arguments, pickled by the parent: only to be unpickled imports what they are of.
            Each is called before the next is unpickled.
    """
    end_with_parent(parent)
    for pickled in begin:
        function, arguments = pickle.loads(pickled)
        function(*arguments)


def end_with_parent(parent: int) -> None:
    """Have the kernel kill this process when its parent ends; to be called first in a worker.

    Args:
        parent: Process id of the parent. A process whose parent is another one, as of a cluster, is left alone.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if sys.platform != "linux":
        return
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)
    if os.getppid() != parent:  # it ended before it could be asked for
        os._exit(1)
