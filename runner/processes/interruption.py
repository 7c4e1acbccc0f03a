"""Ctrl-C and SIGTERM: one line within two seconds that says how to go on, and no process that is left behind.

A signal raises `KeyboardInterrupt` in the main thread, as Python does it, once; a second one does not disturb what is
put in order then. Where the main thread is deep in compiled code and does not come back in time, a thread that was
woken by the signal itself ends the process in its place: it says the line first, since whatever else there is to do may
take long on a machine that is busy.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from types import FrameType
from typing import NoReturn

from runner.processes.workers import kill_workers

PATIENCE_S = 1.0  # for the main thread to come back; the line is there within two seconds
ORDER_S = 0.5  # for what is put in order where it does not come back: the process too has ended by then
SIGNALS = (signal.SIGINT, signal.SIGTERM)
INTERRUPTED = tuple(128 + number for number in SIGNALS)  # exit codes
QUIET_TRACKER = "ignore:resource_tracker:UserWarning"  # it unlinks what an ended process left: the line says enough

_go_on = ""
_at_end: list[Callable[[], object]] = []


class Terminated(KeyboardInterrupt):
    """SIGTERM: ends what is under way as Ctrl-C does."""


@contextmanager
def going_on(words: str, at_end: Callable[[], object]) -> Generator[None]:
    """Say meanwhile how to go on after an interruption.

    Args:
        words: The command to go on with; "": none.
        at_end: Called where the main thread could not be waited for; must be quick.
    """
    global _go_on
    before, _go_on = _go_on, words or _go_on
    _at_end.append(at_end)
    try:
        yield
    except KeyboardInterrupt as error:
        if words and not getattr(error, "going_on", False):
            error.going_on = True  # ty: ignore[missing-attribute]  # a mark, for those further out
            error.args = (" ".join([*map(str, error.args), words]),)  # a command that can be copied to the end
        raise
    finally:
        _go_on = before
        _at_end.remove(at_end)


def line(words: object) -> str:
    """Return the line of an interruption."""
    return f"Interrupted. {words}".strip()


def exit_code(error: KeyboardInterrupt) -> int:
    """Return the exit code that a shell expects: 128 and the signal's number."""
    return 128 + (signal.SIGTERM if isinstance(error, Terminated) else signal.SIGINT)


@contextmanager
def interruptible() -> Generator[None]:
    """Take signals as this module's docstring says; elsewhere than in the main thread nothing is changed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    over, first = threading.Event(), threading.Lock()
    read, write = socket.socketpair()
    write.setblocking(False)
    before = {number: signal.getsignal(number) for number in SIGNALS}
    sys.warnoptions.append(QUIET_TRACKER)  # handed to Python's resource tracker, which starts with the first workers
    threading.Thread(target=_watch, args=(read, over, first), daemon=True).start()
    woken = signal.set_wakeup_fd(write.fileno(), warn_on_full_buffer=False)
    for number in SIGNALS:
        signal.signal(number, _stop)
    try:
        yield
    finally:
        over.set()
        if not first.acquire(blocking=False):  # the line was said meanwhile, and the process is about to end
            threading.Event().wait()
        sys.warnoptions.remove(QUIET_TRACKER)
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(woken)
        write.close()


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise once; what is put in order then is not disturbed."""
    for other in SIGNALS:
        signal.signal(other, signal.SIG_IGN)
    raise Terminated if number == signal.SIGTERM else KeyboardInterrupt


def leave(code: int) -> NoReturn:
    """End this process and its workers at once, without what Python does at its end: on a busy machine that takes long.

    Args:
        code: Its exit code.
    """
    kill_workers()
    with suppress(OSError, ValueError):
        sys.stdout.flush()
    with suppress(OSError, ValueError):
        sys.stderr.flush()
    os._exit(code)


def _watch(read: socket.socket, over: threading.Event, first: threading.Lock) -> None:
    """Wait for the number of a signal, which the signal itself sends, and then for the main thread, but not long."""
    number = 0
    while number not in SIGNALS:
        sent = read.recv(1)
        if not sent:
            read.close()
            return
        number = sent[0]
    if over.wait(PATIENCE_S) or not first.acquire(blocking=False):
        return
    with suppress(OSError, ValueError):
        os.write(sys.stderr.fileno(), (line(_go_on) + "\n").encode())
    end = threading.Timer(ORDER_S, os._exit, (128 + number,))
    end.daemon = True
    end.start()
    kill_workers()
    for call in _at_end:
        with suppress(Exception):
            call()
    os._exit(128 + number)
