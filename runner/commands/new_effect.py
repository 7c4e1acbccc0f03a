"""Begin a new effect: its class with an example of a law, its YAML, and its test, in a clone of the project.

`runner new effect sticky_joint system=mechanism` writes the files and says where; docs/own_effect.md says what to put
into them.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from runner.commands import Command, Job
from runner.commands._catalogue import names
from runner.commands._new import check_name, checkout, write
from runner.errors import ConfigError


class System(Enum):
    """What it may be at work in."""

    planar_box = "planar_box"
    mechanism = "mechanism"


@dataclass(frozen=True)
class NewEffectConfig:
    """`name` is the word of a verdict, `system` what the effect may be at work in."""

    name: str
    system: System = System.planar_box


def main(config: NewEffectConfig, job: Job) -> None:
    """Write the files."""
    name, kind = config.name, config.system.value
    check_name(name)
    if name in names():
        raise ConfigError(f"name: there is a '{name}' already; `runner show {name}` says what it is.")
    root, title = checkout(), "".join(word.capitalize() for word in name.split("_"))
    templates = {
        root / "runner" / "effects" / kind / f"{name}.py": f"effect_{kind}.py.txt",
        root / "tests" / f"test_effect_{name}.py": "effect_test.py.txt",
    }
    if config.system is System.planar_box:
        templates[root / "conf" / "effect" / f"{name}.yaml"] = "effect.yaml.txt"
    write(templates, {"NAME": name, "CLASS": title, "WORDS": name.replace("_", " ")})
    print(f"Then: python -m pytest tests/test_effect_{name}.py; runner show {name}")


COMMAND = Command(config=NewEffectConfig, main=main, positional="name")
