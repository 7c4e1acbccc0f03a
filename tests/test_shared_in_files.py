"""What all targets of a kind share is, in a file, one entry for each of them, also where none of them has it alone."""

from __future__ import annotations

from pathlib import Path

import pytest
from tosses import toss_case, world

from runner.diagnosis.corrected import read_corrected, write_corrected
from runner.systems.case import open_case


def test_every_effect_of_a_tossed_body_comes_back_from_its_file(tmp_path: Path) -> None:
    """A tracker's scale is one for the three axes of a body, and the vocabulary has it of no axis by itself."""
    system = open_case(toss_case(tmp_path / "case", world(), tosses=2))
    assert "sensor_scale[*]" in system.vocabulary.by_name
    assert not any(name.startswith("sensor_scale[") and "*" not in name for name in system.vocabulary.by_name)
    for k, candidate in enumerate(system.vocabulary):
        parameters = candidate.parameters(system.context)
        x = [min(max(0.1 * p.scale, p.lower), p.upper) for p in parameters]
        effects = candidate.make(x, system.context)
        write_corrected(tmp_path / str(k), effects, system)
        back, _ = read_corrected(tmp_path / str(k), system)
        assert [e.full_name for e in back] == [e.full_name for e in effects]
        for one, other in zip(back, effects, strict=True):
            assert one.report() == pytest.approx(other.report())
            assert system.vocabulary.of(one).effect is type(one)
