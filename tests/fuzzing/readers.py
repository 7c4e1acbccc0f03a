"""What is fuzzed: for every kind of input a good one, and the function that reads it as the commands do."""

from __future__ import annotations

import shlex
import shutil
import tempfile
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from runner import commands
from runner.api.tables import read_table
from runner.commands._compose import composer, without_hydra
from runner.commands._execute import composed_for
from runner.commands._explain import built
from runner.commands._multirun import remembered
from runner.commands._stored import stored_run
from runner.commands._sweep import combinations, explain_sweep
from runner.commands._trust import check_kept
from runner.importing.build import build
from runner.importing.entries import plan
from runner.importing.map_file import Map, read_map
from runner.importing.propose import propose
from runner.importing.readers import read_log
from runner.importing.signals import ReadOptions
from runner.physics.forces import CsvForces
from runner.recording import write_case
from runner.recording.model_form_mjcf import read_mjcf
from runner.systems.case import open_case
from runner.teleop.tables import SWEEP
from tests import cases, log_writers, mechanism_cases

Files = Mapping[str, bytes]
SHORT = ("forces.pushes=1", "forces.push_s=0.1", "forces.rest_s=0.1", "forces.lead_s=0.1", "log.rrd=off")
SETTINGS = (
    "seed=3", "forces.lead_s=0.5", "remote.mass_kg=2.5", "remote.com_m=[0.1,0,0]", "effect=[wind,stiction]",
    "remote.effects.wind.force_n=1", "experiment=mine", "start.mass_kg=0.7", "link=noisy",
    "link.noise.position_m=0.001", "estimator=both", "follow=blended", "log.frames=steps",
)  # fmt: skip


@dataclass(frozen=True)
class Reader:
    """A kind of input.

    Attributes:
        good: Files that are read without complaint, by name.
        spoil: Names of those that are spoilt.
        read: Reads them from a folder.
    """

    good: Files
    spoil: tuple[str, ...]
    read: Callable[[Path], object]


def readers(only: str = "") -> dict[str, Reader]:
    """Return all kinds, or those whose name begins with a word; made afresh, without any network or clock."""
    makers: dict[str, Callable[[Path], Reader]] = {
        "config": _config,
        "case_box_csv": lambda place: _box(place, csv=True),
        "case_box_parquet": lambda place: _box(place, csv=False),
        "case_model_csv": lambda place: _model(place, csv=True),
        "case_model_parquet": lambda place: _model(place, csv=False),
        "mjcf": _mjcf,
        "forces": _forces,
        "sweep": _sweep,
        "map": _map,
        "results_run": _results_run,
        "results_sweep": _results_sweep,
        "results_verdict": _results_verdict,
    }
    makers |= {f"log_{kind}": _log_maker(kind) for kind in log_writers.WRITERS}
    with _place() as folder:
        found = {}
        for name, make in makers.items():
            if name.startswith(only):
                (folder / name).mkdir()
                found[name] = make(folder / name)
        return found


@contextmanager
def _place() -> Generator[Path]:
    with tempfile.TemporaryDirectory(prefix="runner-fuzz-") as name:
        yield Path(name)


def files_in(folder: Path) -> dict[str, bytes]:
    """Return all files below a folder by their path."""
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def _box(place: Path, *, csv: bool) -> Reader:
    recording, _ = cases.made(episodes=2, seconds=0.7)
    write_case(recording, place)
    if csv:
        import pandas as pd

        pd.read_parquet(place / "recording.parquet").to_csv(place / "recording.csv", index=False)
        (place / "recording.parquet").unlink()
    good = files_in(place)
    return Reader(good, tuple(good), open_case)


def _model(place: Path, *, csv: bool) -> Reader:
    t = np.arange(40) * 0.01
    columns = {"t": t, "u": np.sin(9 * t), "q_slide": 0.1 * np.sin(3 * t), "dq_slide": 0.3 * np.cos(3 * t)}
    nominal = {
        "commands": {"u": {"actuator": "drive"}},
        "channels": mechanism_cases.joint_channels(["slide"]),
        "start": "free",
    }
    model = mechanism_cases.SLIDE.format(friction=0.1, damping=0.2, mass=2.0, actuator=mechanism_cases.MOTOR)
    mechanism_cases.write_case(place, model, [columns, columns], nominal, csv=csv)
    good = files_in(place)
    return Reader(good, tuple(good), open_case)


def _mjcf(place: Path) -> Reader:
    def read(folder: Path) -> None:
        read_mjcf(folder / "arm.xml").compile()

    parts = '<mujoco><asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset></mujoco>'
    text = log_writers.ARM.replace("<worldbody>", '<include file="parts.xml"/><worldbody>', 1)
    return Reader({"arm.xml": text.encode(), "parts.xml": parts.encode()}, ("arm.xml", "arm.xml", "parts.xml"), read)


def _forces(place: Path) -> Reader:
    rows = ["t,fx,fy,fz,px,py,pz", *(f"{0.1 * k:.1f},{k % 5},{-k % 3},0,0.1,0,0" for k in range(30))]
    return Reader(
        {"forces.csv": "\n".join(rows).encode()}, ("forces.csv",), lambda folder: CsvForces(str(folder / "forces.csv"))
    )


def _config(place: Path) -> Reader:
    """Settings of the command line, and an experiment in a folder of the user's."""
    command = commands.load("run")

    def read(folder: Path) -> None:
        words = (folder / "words.txt").read_bytes().decode("utf-8", "replace").split("\n")
        with composer("run", command) as hydra:
            composed = composed_for(hydra, [f"hydra.searchpath=['file://{folder}']", *(w for w in words if w)])
            built(command, without_hydra(composed), hydra.groups)

    experiment = (
        "# @package _global_\ndefaults:\n  - override /forces: ramp\n  - override /effect: [wind]\n"
        "seed: 5\nremote:\n  mass_kg: 2.0\n  effects:\n    wind:\n      force_n: 1.0\nlink:\n  rate_hz: 30\n"
    )
    return Reader(
        {"words.txt": "\n".join(SETTINGS).encode(), "experiment/mine.yaml": experiment.encode()},
        ("words.txt", "experiment/mine.yaml"),
        read,
    )


def _sweep(place: Path) -> Reader:
    command = commands.load("run")

    def read(folder: Path) -> None:
        _, *kept = remembered(folder / SWEEP)
        check_kept("run", folder / SWEEP, kept, [])
        with composer("run", command) as hydra:
            try:
                combinations(kept, hydra)
            except Exception as error:
                raise explain_sweep(error, hydra, kept) from error

    words = ["run", "start.mass_kg=1,2,3", "link=noisy", "seed=range(0,4)", "hydra/launcher=joblib"]
    return Reader({SWEEP: (shlex.join(words) + "\n").encode()}, (SWEEP,), read)


def _map(place: Path) -> Reader:
    logs, keys = log_writers.csv(place, [log_writers.simulated(0)])
    (place / "arm.xml").write_text(log_writers.ARM)
    compiled = read_mjcf(place / "arm.xml").compile()
    log = read_log(logs, ReadOptions())

    def read(folder: Path) -> None:
        wanted = read_map(folder / "map.yaml", Map)
        build(log, folder / "map.yaml", wanted, plan(folder / "map.yaml", wanted, compiled, "arm.xml"))

    return Reader({"map.yaml": yaml.safe_dump(keys, sort_keys=False).encode()}, ("map.yaml",), read)


def _log_maker(kind: str) -> Callable[[Path], Reader]:
    def make(place: Path) -> Reader:
        logs, keys = log_writers.WRITERS[kind](place, [log_writers.simulated(0)])
        told = keys.get("log", {})
        options = ReadOptions(**{key: told[key] for key in ("decimal", "rate_hz") if key in told})
        names = [log.relative_to(place) for log in logs]
        good = files_in(place)
        (place / "arm.xml").write_text(log_writers.ARM)
        compiled = read_mjcf(place / "arm.xml").compile()

        def read(folder: Path) -> None:
            propose(read_log([folder / name for name in names], options), compiled, rate_hz=options.rate_hz)

        return Reader(good, tuple(good), read)

    return make


def _results_run(place: Path) -> Reader:
    from runner.__main__ import main

    assert main([*SHORT, f"out={place / 'r'}"]) == 0
    good = files_in(place)

    def read(folder: Path) -> None:
        stored_run(folder / "r", "run", commands.load("run"))
        read_table(folder / "r")

    return Reader(good, tuple(n for n in good if "frames" not in n and "versions" not in n), read)


def _results_sweep(place: Path) -> Reader:
    from runner.__main__ import main
    from runner.teleop import tables

    assert main(["-m", "start.mass_kg=1,2", *SHORT, f"out={place / 's'}"]) == 0
    for row in tables.read_summary(place / "s" / tables.SUMMARY):
        tables.Ledger(place / "s", row["job"]).write(row["job"], [row])
    (place / "s" / tables.SUMMARY).unlink()
    shutil.rmtree(place / "s" / "1")
    good = {name: content for name, content in files_in(place).items() if "frames" not in name}
    spoil = tuple(n for n in good if n.endswith((".jsonl", ".txt", "run.yaml")))
    return Reader(good, spoil, lambda folder: read_table(folder / "s"))


def _results_verdict(place: Path) -> Reader:
    verdict = {
        "sentence": "x",
        "ranked": [
            {
                "effects": ["friction"],
                "probability": 0.9,
                "gap_closed": 0.8,
                "parameters": {"friction": {"mu": 0.2}},
                "standard_errors": {"friction": {"mu": 0.01}},
            }
        ],
        "provenance": {"recording_hash": "0" * 32, "versions": {"mujoco": "3.17.0"}},
        "notes": [],
    }
    import json

    text = json.dumps(verdict, indent=1)
    return Reader({"d/verdict.json": text.encode()}, ("d/verdict.json",), lambda folder: read_table(folder / "d"))
