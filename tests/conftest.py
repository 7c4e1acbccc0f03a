"""Settings for all tests: hypothesis draws the same examples every time and has no deadline on a busy machine."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest
import yaml
from hypothesis import settings
from log_writers import ARM, Import, Run, simulated

from runner.__main__ import main

settings.register_profile("project", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("project")


def pytest_collection_finish() -> None:
    """Leave what all tests share out of garbage collection: every full one would go through modules and tests again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session")
def runs() -> list[Run]:
    """Return three runs of a small arm, for logs."""
    return [simulated(k) for k in range(3)]


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Draw no figure in a report of which the text alone is looked at: figures take half of the time."""
    for module in ("motion_figures", "where_figures"):
        monkeypatch.setattr(f"runner.report.{module}.svg", lambda *_: "<svg></svg>")


@pytest.fixture
def run_import(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Import:
    """Return a function that runs `runner import` in a folder with `arm.xml`: exit code, stdout, stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(ARM)

    def call(logs: list[Path], keys: dict | None, *more: str) -> tuple[int, str, str]:
        arguments = ["import", *map(str, logs), "model=arm.xml", *more]
        if keys is not None:
            Path("map.yaml").write_text(yaml.safe_dump(keys, sort_keys=False))
            arguments += ["--map", "map.yaml", "out=case"]
        code = main(arguments)
        out, err = capsys.readouterr()
        return code, out, err

    return call
