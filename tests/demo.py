"""A command for the tests of the command line, with its config; it stands outside the package like a plug-in."""

SOURCE = '''"""Pull a cart.

The longer text.
"""
from __future__ import annotations

import os
import signal
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from runner.commands import Command, Job
from runner.config import registered
from runner.errors import RecordingError, check_range


class Floor(Enum):
    ice = "ice"
    carpet = "carpet"


class AbstractPull(ABC):
    @property
    @abstractmethod
    def force_n(self) -> float: ...


@registered("pull")
@dataclass(frozen=True)
class Steady(AbstractPull):
    force_n: float = 1.0

    def __post_init__(self) -> None:
        check_range("force_n", self.force_n, 0.0, 100.0, unit="N")


@registered("pull")
@dataclass(frozen=True)
class RisingSlowly(AbstractPull):
    slope_n_s: float

    @property
    def force_n(self) -> float:
        return self.slope_n_s


@registered("load")
@dataclass(frozen=True)
class Brick:
    mass_kg: float


@dataclass(frozen=True)
class Cart:
    mass_kg: float = 2.0
    floor: Floor = Floor.ice
    size_m: tuple[float, float] | None = None
    wheels: int = 4
    loads: dict[str, Brick] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_range("mass_kg", self.mass_kg, 0.0, 1e3, unit="kg", lower_open=True)


@dataclass(frozen=True)
class DemoConfig:
    seed: int
    pull: AbstractPull
    cart: Cart
    names: tuple[str, ...] = ()
    act: str = ""


def main(config: DemoConfig, job: Job) -> None:
    if config.act == "refuse":
        raise RecordingError("recording.csv row 3: t goes back.")
    if config.act == "break":
        raise ZeroDivisionError("in the middle")
    if config.act == "interrupt":
        raise KeyboardInterrupt
    if config.act.startswith("die:") and job.number == 1:
        flag = Path(config.act.removeprefix("die:"))
        if not flag.exists():
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    (job.results / "result.txt").write_text(f"{config.seed} {config.pull.force_n} {dict(job.overrides)}")
    print("pulled")


COMMAND = Command(config=DemoConfig, main=main, keeps="demo", positional="names")
'''

PLAIN = '''"""Say what was given."""
from __future__ import annotations

from dataclasses import dataclass

from runner.commands import Command, Job


@dataclass(frozen=True)
class SayConfig:
    path: str
    loud: bool = False


def main(config: SayConfig, job: Job) -> int:
    assert job.folder is None
    print(config.path.upper() if config.loud else config.path)
    return 3 if config.path == "three" else 0


COMMAND = Command(config=SayConfig, main=main, positional="path")
'''

CONF = {
    "demo.yaml": "defaults: [schema_demo, _self_, {pull: steady}, {load: []}, {experiment: null}]\nseed: 1\n",
    "pull/steady.yaml": "defaults: [schema_steady, _self_]\n",
    "pull/rising_slowly.yaml": "defaults: [schema_rising_slowly, _self_]\nslope_n_s: 2\n",
    "load/brick.yaml": "# @package cart.loads.brick\ndefaults: [schema_brick@_here_, _self_]\nmass_kg: 3\n",
    "experiment/both.yaml": "# @package _global_\nseed: 7\n"
    "hydra: {mode: MULTIRUN, sweeper: {params: {pull.force_n: '2,1'}}}\n",
    "experiment/heavy.yaml": "# @package _global_\ndefaults: [{override /pull: rising_slowly}]\ncart: {mass_kg: 50}\n",
    "experiment/typo.yaml": "# @package _global_\ncart: {mas_kg: 50}\n",
    "experiment/text.yaml": "# @package _global_\ncart: {mass_kg: heavy}\n",
}
