"""`runner COMMAND [key=value ...]`: the command line, its exit codes, and one line for every error of a user.

Exit codes: 0 done, 1 a bug or a failed run of a sweep, 2 a setting or an input that can't be used, 130 or 143
interrupted.
"""

from __future__ import annotations

import errno
import os
import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import version
from typing import NoReturn

from runner.commands import _arguments, load
from runner.errors import RunnerError
from runner.processes.interruption import INTERRUPTED, exit_code, interruptible, leave
from runner.processes.interruption import line as interrupted

# no command draws by OpenGL: what is asked for here is loaded when MuJoCo is imported, which fails where it is missing
os.environ["MUJOCO_GL"] = "disable"
# Matrices are small here, and what fills the cores are simulations: threads of linear algebra beside them, or beside
# other cases, wait for each other and burn what those could use (a quarter of a diagnosis on a machine that is busy).
for library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

LONGEST = 2000  # characters of a line for a user
STACK = ("runner", "mujoco", "dm-control", "hydra-core", "rerun-sdk", "numpy", "pandas")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    show_stack = "--traceback" in arguments or bool(os.environ.get("RUNNER_TRACEBACK"))
    try:
        with interruptible():
            code = _dispatch(_arguments.split(arguments))
        sys.stdout.flush()  # what can't be written is said here, not when Python ends
        return code
    except RunnerError as error:
        shown, line, code = error, str(error), 2
    except KeyboardInterrupt as error:
        shown, line, code = error, interrupted(error), exit_code(error)
    except BrokenPipeError:  # the reader of our output has gone
        _give_up_stdout()
        return 141
    except OSError as error:  # files and folders are the user's: full, gone, without permission, too long a name
        shown, line, code = error, _of_system(error), 2
    except MemoryError as error:
        shown, line, code = error, f"The memory does not suffice for this: {error or 'less at a time is needed'}.", 2
    except Exception as error:
        shown, line, code = error, f"runner: a bug: {type(error).__name__}: {error} (--traceback shows where)", 1
    if show_stack:
        traceback.print_exception(shown)
    print(_shortened(" ".join(line.split())), file=sys.stderr)
    return code


def _of_system(error: OSError) -> str:
    """Return what the system refused, and of which file."""
    reason = error.strerror or str(error) or type(error).__name__
    if error.errno == errno.ENOSPC and not error.filename:
        _give_up_stdout()
        return f"What was to be printed can't be written: {reason}."
    return f"{error.filename}: {reason}." if error.filename else f"The system refused something: {reason}."


def _give_up_stdout() -> None:
    """Let what is left to be printed go nowhere, so that Python does not try again at its end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _shortened(line: str) -> str:
    """Return a line without its middle where it is too long to be read: what is allowed stands at its end."""
    return line if len(line) <= LONGEST else f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"


def _dispatch(arguments: _arguments.Arguments) -> int:
    if "version" in arguments.flags:
        print("\n".join(f"{name} {version(name)}" for name in STACK))
        return 0
    if "help" in arguments.flags:
        from runner.commands import _help

        print(_help.of_command(arguments.command) if arguments.named else _help.overview())
        return 0
    from runner.commands import _execute

    overrides = _arguments.overrides(arguments.command, load(arguments.command), arguments.rest)
    if "config" in arguments.flags:
        print(_execute.shown(arguments.command, overrides), end="")
        return 0
    return _execute.execute(arguments.command, overrides, multirun="multirun" in arguments.flags)


def command_line() -> NoReturn:
    """Run the command of this process, and end it."""
    code = main()
    if code in INTERRUPTED:
        leave(code)
    raise SystemExit(code)


if __name__ == "__main__":
    command_line()
