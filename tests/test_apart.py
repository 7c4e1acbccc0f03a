"""Calls in another process: answers, errors, a process that ends, one that does not come back."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import pytest

from runner.errors import RecordingError
from runner.importing.signals import file_error
from runner.processes.apart import EndedError, apart


def test_answers_and_errors_come_back() -> None:
    """From one process that is kept, which is not this one."""
    there = apart(os.getpid, patience_s=30.0)
    assert there not in (os.getpid(), 0)
    assert apart(max, 3, 5, patience_s=30.0) == 5
    with pytest.raises(ValueError, match="invalid literal"):
        apart(int, "three", patience_s=30.0)
    assert apart(os.getpid, patience_s=30.0) == there


def test_a_process_that_aborts_ends_alone() -> None:
    """And the next call has a new one."""
    first = apart(os.getpid, patience_s=30.0)
    with pytest.raises(EndedError, match="signal 6"):
        apart(os.abort, patience_s=30.0)
    assert apart(os.getpid, patience_s=30.0) != first


def test_what_does_not_come_back_is_ended() -> None:
    """Within its time, not when it would have come back."""
    there = apart(os.getpid, patience_s=30.0)
    began = time.monotonic()
    with pytest.raises(EndedError, match="longer than 1 s"):
        apart(time.sleep, 60.0, patience_s=1.0)
    assert time.monotonic() - began < 20.0
    with pytest.raises(ProcessLookupError):
        os.kill(there, 0)


def test_an_error_of_this_project_keeps_its_words() -> None:
    """Errors travel as what they are."""
    error = apart(file_error, "log.mcap", "MCAP", ValueError("cut off."), patience_s=30.0)
    assert isinstance(error, RecordingError)
    assert str(error) == "log.mcap: can't be read as MCAP: cut off."


def test_nothing_is_left_running_when_the_program_ends() -> None:
    """The process that is kept for the next call is ended and waited for, also where a fork of this one has it, too."""
    program = (
        "import os; from runner.processes.apart import apart\n"
        "apart(len, [1], patience_s=60.0)\n"
        "if os.fork() == 0:\n"
        "    raise SystemExit(apart(len, [], patience_s=60.0))\n"
        "raise SystemExit(os.waitstatus_to_exitcode(os.wait()[1]) + apart(len, [], patience_s=60.0))\n"
    )
    words = [sys.executable, "-W", "always::ResourceWarning", "-c", program]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stderr) == (0, "")
