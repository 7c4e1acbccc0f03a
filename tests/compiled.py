"""Compiles what several tests need: `make test` does it while types are checked, which leaves a core idle.

Numba keeps what it compiles on disk. In a fresh clone each process of the tests would otherwise compile the friction
laws and the second physics of boxes and of mechanisms for itself, as they all begin at the same time.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from runner.blind.make import make_cases
from runner.blind.mechanism.maker import Circumstances, MechanismMaker
from runner.blind.planar_box.case import PlanarBoxMaker
from runner.commands._self_test import sliding, swinging

SHORT = Circumstances(episodes=(3, 3), seconds=(3.0, 3.0))


def main() -> None:
    """Let a box slide and a pendulum swing, and make a case of each kind."""
    sliding()
    swinging()
    with tempfile.TemporaryDirectory() as name:
        for maker in (PlanarBoxMaker(), MechanismMaker("pendulum", SHORT)):
            folder = Path(name) / type(maker).__name__
            make_cases(1, 0, folder / "cases", folder / "answers.json", maker, workers=1)


if __name__ == "__main__":
    main()
