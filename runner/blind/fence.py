"""A fence around a process: it opens no file but where it is allowed to, and starts no program.

A hook on the interpreter's own events (`sys.addaudithook`), which can't be taken off again. It holds for most of what
Python code does, and says what it refuses; not for compiled libraries that open files by themselves, nor for paths
from a folder that is open already. Those the kernel keeps in, see `runner.blind.kernel_fence`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import runner
from runner.blind import kernel_fence

PYTHON, PACKAGE = (Path(sys.prefix), Path(sys.base_prefix)), Path(runner.__file__).parent
# what would hand a file, or its content, past the check of `open`
REFUSED = frozenset(
    {"subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.spawn", "os.fork", "os.forkpty", "pty.spawn"}
    | {"os.link", "os.symlink", "socket.connect", "sqlite3.connect"}
)


def fence_of_kernel(folders: Sequence[Path]) -> None:
    """Shut this process in by what the kernel has; to be called before libraries are imported, see `kernel_fence`."""
    os.environ["JOBLIB_MULTIPROCESSING"] = "0"  # it would ask for a semaphore outside, and complain
    kernel_fence.enter([*folders, PACKAGE], PYTHON)  # compiled functions are kept within the package


def enter_fence(folders: Sequence[Path]) -> None:
    """Let this process, from now on and for good, open no file but in these folders, Python's and the package's."""
    allowed = tuple({os.path.realpath(p) for p in (*folders, *PYTHON, PACKAGE)} | {os.devnull})

    def inside(path: Any) -> bool:
        if isinstance(path, int):
            return True  # opened before
        real = os.path.realpath(os.fsdecode(path))
        return any(real == root or real.startswith(root + os.sep) for root in allowed)

    def watch(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            wrong = [] if inside(arguments[0]) else [arguments[0]]
        elif event == "os.rename":
            wrong = [path for path in arguments[:2] if not inside(path)]
        else:
            wrong = [event] if event in REFUSED else []
        if wrong:
            raise PermissionError(f"not while cases are diagnosed blind: {wrong[0]}")

    sys.addaudithook(watch)
