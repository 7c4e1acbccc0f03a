"""Begin a case of a mechanism of your own: its MJCF, how columns belong to it, a script that records, and a test.

`runner new system gripper` writes the folder `gripper`, which works as it stands with a lever in the place of your
mechanism; then put in your own model and log, bit by bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from runner.commands import Command, Job
from runner.commands._new import check_name, write


@dataclass(frozen=True)
class NewSystemConfig:
    """`name` is that of the new folder, `into` where it is made."""

    name: str
    into: Path = Path()


def main(config: NewSystemConfig, job: Job) -> None:
    """Write the files."""
    check_name(config.name)
    folder = config.into / config.name
    templates = {
        "model.xml": "system_model.xml.txt",
        "nominal.yaml": "system_nominal.yaml.txt",
        "record.py": "system_record.py.txt",
        f"test_{config.name}.py": "system_test.py.txt",
    }
    write({folder / file: template for file, template in templates.items()}, {"NAME": config.name})
    print(f"Then: python {folder / 'record.py'}; runner gap {folder}; runner diagnose {folder}")


COMMAND = Command(config=NewSystemConfig, main=main, positional="name")
