"""Make cases with withheld effects, from a physics that is not the simulator's.

`runner blind make n=200 out=DIR` writes one folder per case, and the answers to `DIR.answers.json` beside it (or to
`answers=FILE`, never inside DIR). The SHA-256 of the answers is printed and stands in `DIR/answers.sha256`, so that
nobody can change them after a diagnosis. Without `seed` one is drawn, and printed. Called again with the same words
after an interruption, it goes on with the cases that are missing.

`system` says of what: `planar_box` (the default), `pendulum`, `arm2` (two links in a vertical plane) or `slider_servo`,
each by a physics of its own, or `planar_box_drake`: boxes in a second world, by Drake (`pip install 'runner[blind]'`),
with pushes and outsiders of its own. How far that world is from what its owner believes is `roughness`: 0 not at all, 1
(the default there) by up to two noises. `free_body_drake` is a cube, a box or a cylinder that is tossed onto a table,
let fall and slid over it, by Drake too: a case is an MJCF with a free joint and a log of poses.

With `purpose=tuning` half of the kinds of effects that no verdict has a word for are left out, the same half in every
such set: what a diagnosis does with the others shows only in a set that is made to be scored (`purpose=sealed`, the
default), which has all, and no case in common with a tuning set of the same seed.

    runner blind make n=200 out=blind
    runner blind run blind out=blind_verdicts
    runner blind score verdicts=blind_verdicts answers=blind.answers.json cases=blind
"""

from __future__ import annotations

import secrets
from dataclasses import dataclass
from pathlib import Path

from runner.blind.checkpoint import header
from runner.blind.make import Purpose, make_cases, part_of
from runner.blind.worlds import MAKERS
from runner.commands import Command, Job
from runner.effects.wording import counted
from runner.errors import ConfigError, check_range, check_workers, nearest

PURPOSES = tuple(purpose.value for purpose in Purpose)


@dataclass(frozen=True)
class BlindMakeConfig:
    """`n` cases of a `system` are made in the new folder `out` from `seed` (None: drawn).

    `answers` is the file of the sealed answers (None: beside `out`). `purpose` is `sealed` or `tuning`; the latter
    leaves out half of the kinds of effects that no verdict has a word for. `roughness` is of worlds by Drake. `workers`
    make cases at a time (None: one per core).
    """

    n: int
    out: Path
    system: str = "planar_box"
    purpose: str = Purpose.SEALED.value
    roughness: float | None = None
    seed: int | None = None
    answers: Path | None = None
    workers: int | None = None

    def __post_init__(self) -> None:
        check_range("n", self.n, 1, 100000)
        for key, value, valid in (("system", self.system, MAKERS), ("purpose", self.purpose, PURPOSES)):
            if value not in valid:
                raise ConfigError(f"{key}: no '{value}'. {nearest(value, valid)}")
        if self.seed is not None:
            check_range("seed", self.seed, 0, 2**63 - 1)
        check_workers(self.workers)


def main(config: BlindMakeConfig, job: Job) -> None:
    """Make them and print the hash."""
    if not config.out.resolve().name:
        raise ConfigError(f"out: must be a new folder, got '{config.out}'.")
    answers = config.answers or config.out.resolve().with_name(f"{config.out.resolve().name}.answers.json")
    if answers.exists():
        raise ConfigError(f"answers: '{answers}' exists; name a new file.")
    seed, drawn = config.seed, ""
    if seed is None:
        begun = header(part_of(answers)) or {}
        # a small seed could be found again from the names that follow from it, and the answers with it
        seed, drawn = begun.get("seed", secrets.randbelow(2**63)), ", drawn"
    maker, purpose = MAKERS[config.system], Purpose(config.purpose)
    if config.roughness is not None:
        maker = maker.with_roughness(config.roughness)
    maker.check_ready()
    print(f"{counted(config.n, 'case')}: {config.out} (seed {seed}{drawn})", flush=True)
    made = make_cases(config.n, seed, config.out, answers, maker, purpose=purpose, workers=config.workers)
    print(f"answers: {made.answers}")
    print(f"SHA-256 of the answers: {made.sha256}")


COMMAND = Command(config=BlindMakeConfig, main=main, again="Go on with")
