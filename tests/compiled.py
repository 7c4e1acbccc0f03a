"""Compiles what several tests need: `python -m tests.compiled laws`, and beside it `worlds`, before they all begin.

Numba keeps what it compiles on disk. In a fresh clone each process of the tests would otherwise compile the friction
laws and the second physics of boxes and of mechanisms for itself, as they all begin at the same time. So it is with the
bytecode of what commands import, where Python is kept from writing any: tests start many commands.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from runner import commands
from runner.blind.make import make_cases
from runner.blind.mechanism.maker import Circumstances, MechanismMaker
from runner.blind.planar_box.case import PlanarBoxMaker
from runner.commands._self_test import sliding, swinging
from runner.numerics.recursive_filter import filtered

SHORT = Circumstances(episodes=(3, 3), seconds=(3.0, 3.0))


def laws() -> None:
    """Let a box slide, a pendulum swing and a filter run."""
    sliding()
    swinging()
    filtered(np.zeros(2), 1.0, 0.0, 0.0)


def worlds() -> None:
    """Make a case of each kind, and import every command."""
    for name in commands.names():
        commands.load(name)
    with tempfile.TemporaryDirectory() as name:
        for maker in (PlanarBoxMaker(), MechanismMaker("pendulum", SHORT)):
            folder = Path(name) / type(maker).__name__
            make_cases(1, 0, folder / "cases", folder / "answers.json", maker, workers=1)


if __name__ == "__main__":
    {"laws": laws, "worlds": worlds}[sys.argv[1]]()
