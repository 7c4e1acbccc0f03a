"""What is made to fail: a command, what lies there before it, and what may lie there after it."""

from __future__ import annotations

import re
import shutil
from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pyarrow.parquet as pq
from rerun.chunk import RrdReader

from runner.__main__ import main
from runner.api.tables import read_table
from runner.commands._execute import shown
from runner.diagnosis.pipeline import diagnose
from runner.diagnosis.verdict import ALL
from runner.diagnosis.verdict import FILE as VERDICT
from runner.outputs.many import collect, has_verdict
from runner.progress import UNOBSERVED, ProgressObserver
from runner.recording import write_case
from runner.recording.case import content_hash
from runner.report.html import render
from runner.report.record import write_rrd
from runner.storage.provenance import program
from runner.storage.reading import read_json
from runner.storage.run_status import FILE as RUN
from runner.storage.run_status import Status, status_of
from runner.storage.writing import write_bytes
from runner.storage.yaml_text import read_yaml
from runner.systems.case import open_case
from runner.teleop import tables
from tests.cases import made
from tests.faults.kept import keep, kept

SHORT = ("forces.pushes=1", "forces.push_s=0.1", "forces.rest_s=0.1", "forces.lead_s=0.1")
PART = re.compile(r"\..*\.[0-9a-f]{8}(\..*)?")  # a file under its temporary name


class Scenario(ABC):
    """A command that writes.

    Args:
        folder: Where it writes; faults are counted below it.
        apart: Where it may keep what it needs.
    """

    def __init__(self, folder: Path, apart: Path) -> None:
        self.folder, self.apart = folder, apart

    def before(self) -> None:
        """Write what is there before; called once, in a process of its own."""

    @abstractmethod
    def act(self) -> int:
        """Do it, and return the exit code."""

    @abstractmethod
    def check(self, *, done: bool) -> None:
        """Assert that what is there is old or new; `done`: the command said that it went well."""

    def check_goes_on(self) -> None:
        """Assert that what did not end well comes to its end by the command that a user is told, if there is one."""


class Run(Scenario):
    """A run into a new folder, with frames, steps and `.rrd`."""

    LEFT = frozenset({"frames.parquet", "steps.parquet", "run.rrd"})
    SETTINGS = (*SHORT, "log.frames=steps")

    def act(self) -> int:
        return main(["run", *self.SETTINGS, f"out={self.folder / 'r'}"])

    def check(self, *, done: bool) -> None:
        whole(self.folder)
        folder = self.folder / "r"
        status = status_of(folder) if (folder / RUN).is_file() else None
        assert status is Status.done or not done
        if status is not None:
            assert read_table(folder).iloc[0]["status"] == status.value
        if status is Status.done:
            assert {f.name for f in folder.iterdir()} >= self.LEFT
        else:
            assert status in (None, Status.failed, Status.killed)


class RunAgain(Run):
    """The same, but for `.rrd`, into a folder that holds the results of the same settings."""

    LEFT = Run.LEFT - {"run.rrd"}
    SETTINGS = (*SHORT, "log.frames=steps", "log.rrd=off")

    def before(self) -> None:
        assert self.act() == 0

    def check(self, *, done: bool) -> None:
        super().check(done=done)
        assert (self.folder / "r" / RUN).is_file()


class Sweep(Scenario):
    """A sweep of three; what was noted before is not lost, and it resumes to the same table."""

    def act(self) -> int:
        return main(["run", "-m", "start.mass_kg=1,2,3", *SHORT, "log.rrd=off", f"out={self.folder / 's'}"])

    def check(self, *, done: bool) -> None:
        whole(self.folder)
        folder = self.folder / "s"
        if not (folder / tables.SWEEP).is_file():
            assert not done
        if done:
            self.check_table(folder)

    def check_goes_on(self) -> None:
        folder = self.folder / "s"
        if (folder / tables.SWEEP).is_file():
            assert main(["run", f"resume={folder}"]) == 0
            self.check_table(folder)

    def check_table(self, folder: Path) -> None:
        """Assert that all runs stand in the table, each with its frames."""
        table = read_table(folder)
        assert table["status"].tolist() == ["done"] * 3
        assert table["start.mass_kg"].tolist() == [1, 2, 3]
        assert all((folder / str(k) / "frames.parquet").is_file() for k in range(3))


class Table(Scenario):
    """A table over one that is there."""

    OLD = "the table of before\n" * 1000

    def before(self) -> None:
        assert main(["run", *SHORT, "log.rrd=off", f"out={self.apart / 'r'}"]) == 0
        (self.folder / "t.csv").write_text(self.OLD)
        assert main(["table", str(self.apart / "r"), f"out={self.apart / 'new.csv'}"]) == 0

    def act(self) -> int:
        return main(["table", str(self.apart / "r"), f"out={self.folder / 't.csv'}"])

    def check(self, *, done: bool) -> None:
        new = (self.apart / "new.csv").read_text()
        assert (self.folder / "t.csv").read_text() in ((new,) if done else (self.OLD, new))


class Case(Scenario):
    """A recording, as the API writes it."""

    def act(self) -> int:
        write_case(made(episodes=1, seconds=0.5)[0], self.folder / "c")
        return 0

    def check(self, *, done: bool) -> None:
        whole(self.folder)
        if done:
            open_case(self.folder / "c")


class Diagnosis(Scenario):
    """`runner diagnose` of a case into a new folder: `run.yaml`, what is found so far, tables, page, `.rrd`, verdict.

    What is written of it is found, and its page drawn, once before, as neither writes anything.
    """

    def __init__(self, folder: Path, apart: Path) -> None:
        super().__init__(folder, apart)
        self.case, self.results = apart / "case", folder / "d"

    def before(self) -> None:
        self.find(self.case, seed=1)

    def find(self, case: Path, *, seed: int) -> None:
        """Write a recording, and keep what its diagnosis finds."""
        write_case(made(episodes=2, seconds=1.0, seed=seed)[0], case)
        found = diagnose(open_case(case), threads=1)
        keep((found, render(found)), self.apart / content_hash(case))

    def act(self) -> int:
        with self.found_before():
            return main(["diagnose", str(self.case), f"out={self.results}"])

    @contextmanager
    def found_before(self) -> Generator[None]:
        """Take what was found before for what a diagnosis finds."""
        pages: list[str] = []

        def again(system: Any, *, observer: ProgressObserver = UNOBSERVED, **_: Any) -> Any:
            observer.best(("mass",), 1.0, 0.9)
            found, page = kept(self.apart / content_hash(system.recording.path))
            pages.append(page)
            return found

        with (
            patch("runner.diagnosis.pipeline.diagnose", again),
            patch("runner.report.html.render", lambda *_: pages[-1]),
        ):
            yield

    def check(self, *, done: bool) -> None:
        whole(self.folder)
        status = status_of(self.results) if (self.results / RUN).is_file() else None
        assert status is Status.done or not done
        for results, case in self.verdicts():
            check_verdict(results, case, done=done)
            assert (results / VERDICT).is_file() or status is not Status.done

    def check_goes_on(self) -> None:
        assert self.act() == 0
        self.check(done=True)

    def verdicts(self) -> list[tuple[Path, Path]]:
        """Return where verdicts belong, and the cases that they are of."""
        return [(self.results, self.case)]


class DiagnosisAgain(Diagnosis):
    """The same into the folder that holds what it found before; Rerun's own writes are gone through by the other."""

    @contextmanager
    def found_before(self) -> Generator[None]:
        with super().found_before(), patch("runner.report.record.write_rrd", self._write_again):
            yield

    def _write_again(self, found: Any, path: Path) -> None:
        """Write the `.rrd` of a diagnosis, which is drawn once."""
        drawn = self.apart / f"{found.system.recording.path.name}.rrd"
        if not drawn.is_file():
            write_rrd(found, drawn)
        write_bytes(path, drawn.read_bytes())

    def before(self) -> None:
        super().before()
        assert self.act() == 0


class Diagnoses(DiagnosisAgain):
    """`runner diagnose` of a folder of two by a launcher, into what was found before one of the recordings changed."""

    def __init__(self, folder: Path, apart: Path) -> None:
        super().__init__(folder, apart)
        self.case, self.verdict = apart / "cases", self.results / "same" / VERDICT

    def before(self) -> None:
        changed = self.case / "changed"
        self.find(self.case / "same", seed=1)
        self.find(changed, seed=2)
        assert self.act() == 0
        shutil.rmtree(changed)
        self.find(changed, seed=3)
        shutil.copy(self.verdict, self.apart / "kept.json")

    def act(self) -> int:
        def here(calls: Sequence[Callable[[], object]]) -> None:
            for call in calls:
                call()

        with self.found_before(), patch("runner.commands._execute._spread", return_value=here):
            return main(["diagnose", str(self.case), f"out={self.results}"])

    def verdicts(self) -> list[tuple[Path, Path]]:
        return [(self.results / name, self.case / name) for name in ("same", "changed")]

    def check(self, *, done: bool) -> None:
        super().check(done=done)
        assert self.verdict.read_bytes() == (self.apart / "kept.json").read_bytes()
        if done:
            assert collect(self.results, ("same", "changed")) == read_json(self.results / ALL)


def check_verdict(results: Path, case: Path, *, done: bool) -> None:
    """Assert that where the verdict of a case is, all else is, and that it is there if the command said so."""
    there = has_verdict(results, case)
    assert there or not done
    if there:
        left = {"closure.parquet", "where_gap.parquet", "corrected.yaml", "report.html", "diagnosis.rrd"}
        assert left <= {f.name for f in results.iterdir()}


def whole(folder: Path) -> None:
    """Assert that every file below a folder is one, save for those under temporary names and lines of notes."""
    for file in folder.rglob("*"):
        if PART.fullmatch(file.name) or not file.is_file():
            continue
        if file.suffix == ".parquet":
            pq.read_table(file)
        elif file.suffix == ".rrd":
            assert list(RrdReader(file).stream())
        elif file.suffix == ".yaml":
            assert read_yaml(file) is not None
        elif file.suffix == ".json":
            read_json(file)
        elif file.suffix == ".html":
            assert file.read_text().rstrip().endswith("</html>")


def warm() -> None:
    """Import and do once what commands do before they write, as each fault is a fork, which had to do so again."""
    import runner.commands.table
    import runner.teleop.sinks.run_log  # noqa: F401

    shown("run", [])
    shown("diagnose", ["recording=."])
    program()


def reset(folder: Path, before: Path) -> None:
    """Put back what was there before."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(before, folder)


SCENARIOS: dict[str, type[Scenario]] = {
    "run": Run, "run_again": RunAgain, "sweep": Sweep, "table": Table, "case": Case, "diagnosis": Diagnosis,
    "diagnosis_again": DiagnosisAgain, "diagnoses": Diagnoses,
}  # fmt: skip
