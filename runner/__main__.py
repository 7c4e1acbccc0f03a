"""`runner COMMAND [key=value ...]`: the command line, its exit codes, and one line for every error of a user.

Exit codes: 0 done, 1 a bug or a failed run of a sweep, 2 a setting or an input that can't be used, 130 interrupted.
"""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Sequence
from importlib.metadata import version

from runner.commands import _arguments, load
from runner.errors import RunnerError

os.environ.setdefault("MUJOCO_GL", "disable")  # nothing is drawn; else GLFW warns where there is no display

STACK = ("runner", "mujoco", "dm-control", "hydra-core", "rerun-sdk", "numpy", "pandas")


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    show_stack = "--traceback" in arguments or bool(os.environ.get("RUNNER_TRACEBACK"))
    try:
        return _dispatch(_arguments.split(arguments))
    except RunnerError as error:
        shown, line, code = error, str(error), 2
    except KeyboardInterrupt as error:
        shown, line, code = error, f"Interrupted. {error}", 130
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except Exception as error:
        shown, line, code = error, f"runner: a bug: {type(error).__name__}: {error} (--traceback shows where)", 1
    if show_stack:
        traceback.print_exception(shown)
    print(" ".join(line.split()), file=sys.stderr)
    return code


def _dispatch(arguments: _arguments.Arguments) -> int:
    if "version" in arguments.flags:
        print("\n".join(f"{name} {version(name)}" for name in STACK))
        return 0
    from runner.commands import _execute, _help

    if "help" in arguments.flags:
        print(_help.of_command(arguments.command) if arguments.named else _help.overview())
        return 0
    overrides = _arguments.overrides(arguments.command, load(arguments.command), arguments.rest)
    if "config" in arguments.flags:
        print(_execute.shown(arguments.command, overrides), end="")
        return 0
    return _execute.execute(arguments.command, overrides, multirun="multirun" in arguments.flags)


if __name__ == "__main__":
    raise SystemExit(main())
