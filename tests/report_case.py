"""A diagnosis for the tests of the report: a floor that is more slippery than believed."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd

from runner.effects.planar_box import Friction
from runner.localise.where import localise
from runner.noise.measured import Measured
from runner.noise.model import NoiseModel
from runner.recording import Episode, Form, Noise, Nominal, Recording, Span
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run

RATE_HZ, DURATION_S = 60.0, 3.0
SIGMA = np.array([5e-4, 5e-4, 1e-3, 5e-3, 5e-3, 1e-2])
TRUE = Friction(0.27)
NOMINAL = Nominal((0.5, 0.5, 0.5), 3.0, 0.3, 9.81, RATE_HZ, noise=Noise(5e-4, 1e-3, 5e-3, 1e-2))


def ranked(effects: tuple[str, ...], chance: float, **other: Any) -> Any:
    """Return one explanation."""
    empty = {
        "equivalent": (), "values": (), "parameters": {}, "errors": {}, "gap_closed": None, "log_evidence": 0.0,
        "equal_numbers": {},
    }  # fmt: skip
    return SimpleNamespace(**({"effects": effects, "probability": chance} | empty | other))


def pushed(index: int, seed: int) -> Episode:
    """Return an episode of pushes, its motion still to be simulated."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(RATE_HZ * DURATION_S) + 1) / RATE_HZ
    force, point = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    force[: len(t) // 2, :2] = 14 * np.array([math.cos(seed), math.sin(seed)])
    point[: len(t) // 2, :2] = rng.uniform(-0.2, 0.2, 2)
    return Episode(index, t, np.zeros((len(t), 3)), np.zeros((len(t), 3)), force, point)


@cache
def slippery() -> Recording:
    """Return a recording of a floor that is more slippery than believed, with noise."""
    still = Recording(Path("slippery"), Form.PLANAR, NOMINAL, tuple(pushed(3 + i, 5 + i) for i in range(3)))
    simulator, rng = PlanarBox(still).simulator(), np.random.default_rng(1)
    episodes = []
    for e, episode in enumerate(still.episodes):
        motion = simulator.predict(e, [Run((TRUE,), np.zeros(6))])[0]
        motion = motion + SIGMA * rng.standard_normal(motion.shape)
        episodes.append(replace(episode, pose=motion[:, :3], twist=motion[:, 3:]))
    return replace(still, episodes=tuple(episodes))


@cache
def diagnosis() -> Any:
    """Return a diagnosis that found the friction."""
    recording = slippery()
    values = tuple(np.hstack([e.pose, e.twist]) for e in recording.episodes)
    valid = tuple(np.ones(v.shape, bool) for v in values)
    spans = tuple(Span(e, 0, len(v)) for e, v in enumerate(values))
    measured = Measured(spans, values, SIGMA, NoiseModel.white(6), valid, SIGMA)
    system = PlanarBox(recording)
    rows = [
        {"episode": 5, "channel": c.name, "before": 9 * s, "after": 1.1 * s, "noise": s, "unit": c.unit}
        for c, s in zip(system.channels, SIGMA, strict=True)
    ]
    friction = ranked(
        ("friction",),
        0.985,
        parameters={"friction": {"mu": 0.2704}},
        errors={"friction": {"mu": 0.0012}},
        gap_closed=0.87,
    )
    return SimpleNamespace(
        case="slippery",
        system=system,
        recording=recording,
        ranked=(friction, ranked(("none",), 0.01, gap_closed=0.0), ranked(("unknown",), 0.005)),
        abstain=False,
        gap_closed=0.87,
        effects=(TRUE,),
        fitted=(0, 1),
        held_out=(2,),
        measured=measured,
        stretches=tuple(Span(e, 0, len(v)) for e, v in enumerate(system.values())),
        nominal_starts={e: np.zeros(6) for e in range(3)},
        corrected_starts={e: np.zeros(6) for e in range(3)},
        where=localise(system, measured, {e: np.zeros(6) for e in range(3)}),
        closure=SimpleNamespace(
            table=pd.DataFrame(rows),
            regimes=pd.DataFrame([{"regime": "pushed straight", "windows": 31, "before": 9.0, "after": 1.02}]),
            gap_closed=0.87,
            gap_closed_low=0.85,
            gap_closed_high=0.88,
            closable_closed=0.98,
        ),
        rivals=(),
        abstention=None,
        flights=None,
        excess=0.01,
        nominal_excess=4.0,
        drive_excess=0.0,
        left_by_episode={3: 1.0, 4: -2.0, 5: 0.5},
        wall_s=12.0,
        cpu_s=20.0,
        simulated_s=4000.0,
        next_push=None,
        doubts=(),
        notes=("Only <one> episode was left to check the explanation.",),
    )


def changed(diagnosis: Any, **other: Any) -> Any:
    """Return a diagnosis with other values."""
    return SimpleNamespace(**(vars(diagnosis) | other))


def said(text: str) -> str:
    """Return what a page shows, without its tags, styles and figures' numbers."""

    class Reader(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.parts, self.skip = [], False

        def handle_starttag(self, tag: str, attrs: Any) -> None:
            self.skip = tag == "style"

        def handle_endtag(self, tag: str) -> None:
            self.skip = False

        def handle_data(self, data: str) -> None:
            if not self.skip:
                self.parts.append(data)

    reader = Reader()
    reader.feed(text)
    return " ".join(" ".join(reader.parts).split())
