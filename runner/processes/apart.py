"""Call a function in another process: a library that aborts on a spoilt file, or never comes back, ends that one alone.

The process is started with the first call and kept for the next ones, as it takes a second or two to import what it
needs. What goes to and fro is pickled by this program on both sides, and never read from a file.
"""

from __future__ import annotations

import atexit
import os
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection, Pipe
from typing import Any

from runner.processes.workers import end_with_parent, shielded

LOOKED_S = 0.5  # between two looks at whether this process was interrupted


class EndedError(Exception):
    """The other process ended, or was ended, before it had an answer; the message says how."""


class _Apart:
    """The other process and the line to it."""

    def __init__(self) -> None:
        self.line, theirs = Pipe()
        handle = theirs.fileno()
        command = [sys.executable, "-m", "runner.processes.apart", str(handle), str(os.getpid())]
        with shielded():
            # what an aborting library says is for its authors
            self.process = subprocess.Popen(command, pass_fds=[handle], stderr=subprocess.DEVNULL)
        theirs.close()

    def end(self) -> int:
        """End the process and return how it ended."""
        self.line.close()
        self.process.kill()
        return self.process.wait()


_kept: list[_Apart] = []


def apart(function: Callable[..., Any], *arguments: Any, patience_s: float) -> Any:
    """Return what a function of this package returns in another process, or raise what it raises there.

    Args:
        function: To be found by its name; so are the arguments' classes.
        arguments: Its arguments.
        patience_s: How long it may take.

    Raises:
        EndedError: If the process was ended by what it did, or had to be.
    """
    _let_go_of_others()
    if not _kept:
        _kept.append(_Apart())
    other = _kept[0]
    try:
        other.line.send((function, arguments))
        until = time.monotonic() + patience_s
        while not other.line.poll(min(LOOKED_S, max(until - time.monotonic(), 0.0))):
            if time.monotonic() >= until:
                raise EndedError(f"took longer than {patience_s:.0f} s")
        answered, answer = other.line.recv()
    except (EOFError, BrokenPipeError, ConnectionResetError):
        _kept.clear()
        raise EndedError(f"ended the process that read it ({_reason(other.process.wait())})") from None
    except BaseException:
        _kept.clear()
        other.end()
        raise
    if not answered:
        raise answer
    return answer


def _let_go_of_others() -> None:
    """Forget the process that is kept if it has ended, or is that of the process which this one was forked from."""
    if _kept and _kept[0].process.poll() is not None:  # of a process that is no child of its own it says that, too
        _kept.clear()


@atexit.register
def _end() -> None:
    _let_go_of_others()
    while _kept:
        _kept.pop().end()


def _reason(code: int) -> str:
    return f"signal {-code}" if code < 0 else f"exit code {code}"


def _serve(handle: int, parent: int) -> None:
    """Answer calls until the line is closed."""
    end_with_parent(parent)
    line = Connection(handle)
    with suppress(EOFError, OSError):
        while True:
            function, arguments = line.recv()
            try:
                answer = True, function(*arguments)
            except Exception as error:
                answer = False, error
            line.send(answer)


if __name__ == "__main__":
    _serve(int(sys.argv[1]), int(sys.argv[2]))
