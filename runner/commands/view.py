"""Open a recording in the Rerun viewer: an `.rrd` file, or the one in a results folder.

`runner view PATH` opens the viewer that was installed with this program. `--web` serves it to a browser instead, also
from a machine without a display, until Ctrl-C; to this machine alone unless `bind=0.0.0.0` lets others in. From another
one: `ssh -L 9090:localhost:9090 -L 9876:localhost:9876 MACHINE`.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from runner.commands import Command, Job
from runner.errors import ConfigError

ENDING = ".rrd"
VIEWER = "rerun"


@dataclass(frozen=True)
class ViewConfig:
    """`path` is what to show. `web` serves it to a browser, at the address `bind` of this machine."""

    path: Path
    web: bool = False
    bind: str = "127.0.0.1"


def main(config: ViewConfig, job: Job) -> int:
    """Open the viewer and wait for its end."""
    file = recording_in(config.path)
    program = viewer()
    if program is None:
        raise ConfigError(
            f"view: no program '{VIEWER}', neither beside '{sys.executable}' nor on the PATH; install rerun-sdk, or "
            f"open '{file}' where it is."
        )
    if not config.web and not has_display():
        raise ConfigError(
            f"view: there is no display here; serve it with: runner view {file} --web, or copy it to a machine that "
            f"has one: rerun {file.name}"
        )
    served = ["--serve-web", "--bind", config.bind] if config.web else []
    # a name of its own may begin with '-', which would be an option of the viewer
    return subprocess.run([program, str(file.absolute()), *served], check=False).returncode


def recording_in(path: Path) -> Path:
    """Return the one `.rrd` file that a path names, or that lies in that folder.

    Raises:
        ConfigError: If there is none, or several.
    """
    if path.is_file():
        if path.suffix != ENDING:
            raise ConfigError(f"path: must be an {ENDING} file or a folder that holds one, got '{path}'.")
        return path
    if not path.is_dir():
        raise ConfigError(f"path: no file or folder '{path}'.")
    found = sorted(path.glob(f"*{ENDING}")) or sorted(path.rglob(f"*{ENDING}"))
    if not found:
        raise ConfigError(f"path: no {ENDING} file in '{path}'; `runner run` and `runner diagnose` write one.")
    if len(found) > 1:
        more = f" and {len(found) - 5} more" if len(found) > 5 else ""
        raise ConfigError(
            f"path: several {ENDING} files in '{path}': {', '.join(map(str, found[:5]))}{more}; name one."
        )
    return found[0]


def viewer() -> str | None:
    """Return the viewer's program: the one of this environment, be it activated or not, else one on the PATH."""
    beside = shutil.which(VIEWER, path=str(Path(sys.executable).parent))
    return beside or shutil.which(VIEWER)


def has_display() -> bool:
    """Tell whether a window can be opened."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


COMMAND = Command(config=ViewConfig, main=main, positional="path")
