"""What an owner has measured is not tried: `known` in `nominal.yaml`."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from runner.diagnosis.known import contradicted
from runner.diagnosis.notes import notes
from runner.errors import RecordingError
from runner.inference.contender import contend
from runner.inference.evidence import directions, sensitivities
from runner.inference.least_squares import NONE, Explanation, Fitter
from runner.inference.search import Search
from runner.noise.measured import measure
from runner.recording import write_case as write_box_case
from runner.systems.base import AbstractSystem
from runner.systems.case import open_case
from tests.mechanism_cases import MOTOR, SLIDE, joint_channels, system_of, write_case
from tests.mechanisms import ARM
from tests.recording_cases import planar
from tests.test_exchange import BELIEVED_KG, DAMPING, MASS_KG, NOISE, driven

T_S = 0.01 * np.arange(40)
SHOWN = {"t": T_S, "u": np.sin(T_S), "s": 0.1 * np.sin(9 * T_S), "e": 0.1 * np.cos(9 * T_S)}
NOMINAL = {
    "commands": {"u": {"actuator": "elbow"}},
    "channels": {
        "s": {"joint": "shoulder", "quantity": "position"},
        "e": {"joint": "elbow", "quantity": "position"},
    },
}


def arm(folder: Path, *known: str) -> AbstractSystem:
    """Return an arm of which so much is known."""
    return open_case(write_case(folder, ARM, [SHOWN, SHOWN], {**NOMINAL, "known": list(known)}))


def names(system: AbstractSystem) -> set[str]:
    return {c.name for c in system.vocabulary}


def test_what_is_known_is_not_tried(tmp_path: Path) -> None:
    """Of one target, of all by the bare name, and of all of a kind where one of them is known."""
    every = names(arm(tmp_path / "all"))
    assert every - names(arm(tmp_path / "one", "mass[forearm]")) == {"mass[forearm]"}
    assert every - names(arm(tmp_path / "bare", "mass")) == {"mass[forearm]", "mass[upper]"}
    gone = every - names(arm(tmp_path / "shared", "backlash[elbow]"))
    assert gone == {"backlash[elbow]", "backlash[*]"}


def test_it_is_said(tmp_path: Path) -> None:
    """A reader of the verdict knows what could not be named; a corrected model may still hold it."""
    system = arm(tmp_path, "mass[forearm]", "gravity")
    assert "Not tried, as nominal.yaml says that it is known: gravity and mass of forearm." in notes(
        system, measure(system), (1,)
    )
    assert "mass[forearm]" in system.vocabulary.by_name


def test_a_box_has_it_too(tmp_path: Path) -> None:
    """The same key."""
    write_box_case(planar(), tmp_path)
    nominal = tmp_path / "nominal.yaml"
    before = names(open_case(tmp_path))
    nominal.write_text(yaml.safe_dump({**yaml.safe_load(nominal.read_text()), "known": ["mass", "floor_tilt"]}))
    assert before - names(open_case(tmp_path)) == {"mass", "floor_tilt"}


@pytest.mark.parametrize(
    ("known", "said"),
    [
        (
            ["mass[foream]"],
            r"nominal\.yaml: known: no effect 'mass\[foream\]' here\. Valid: 'mass\[forearm\]', 'mass\[upper\]'\. "
            r"Did you mean 'mass\[forearm\]'\?$",
        ),
        (["mas"], r"no effect 'mas' here\. Valid: 'actuator_delay', .* Did you mean 'mass'\?$"),
        ("gravity", r"nominal\.yaml: known: must be a list of effects, such as \[gravity\], got 'gravity'"),
        ([3], r"known: must be a list of effects, .* got \[3\]"),
    ],
)
def test_what_is_no_effect_is_refused(known: object, said: str, tmp_path: Path) -> None:
    """With the file, the key, and what was probably meant."""
    folder = write_case(tmp_path, ARM, [SHOWN, SHOWN], {**NOMINAL, "known": known})
    with pytest.raises(RecordingError, match=said):
        open_case(folder)


def test_a_name_with_brackets_in_brackets_needs_quotes(tmp_path: Path) -> None:
    """As one would write it from `[gravity]`."""
    folder = write_case(tmp_path, ARM, [SHOWN, SHOWN], NOMINAL)
    nominal = folder / "nominal.yaml"
    nominal.write_text(nominal.read_text() + "known: [mass[forearm]]\n")
    with pytest.raises(RecordingError, match=r"nominal\.yaml: line \d+, .*\['mass\[link\]'\]"):
        open_case(folder)
    nominal.write_text(nominal.read_text().replace("[mass[forearm]]", "['mass[forearm]']"))
    assert "mass[forearm]" not in names(open_case(folder))


@pytest.mark.parametrize(
    ("mass_kg", "damping", "found", "false"),
    [
        (BELIEVED_KG, DAMPING, ("actuator_gain[drive]", "joint_damping[slide]"), True),
        (MASS_KG, 0.5 * DAMPING, ("joint_damping[slide]",), False),
    ],
)
def test_what_is_known_and_false_is_said(
    mass_kg: float, damping: float, found: tuple[str, ...], false: bool, tmp_path: Path
) -> None:
    """Said to be weighed, a wrong mass passes for two causes that do the same; nothing is said of a right one."""
    model = SLIDE.format(damping=damping, friction=0, mass=mass_kg, actuator=MOTOR)
    nominal = {
        "commands": {"u": {"actuator": "drive"}}, "channels": joint_channels(["slide"]), "noise": NOISE,
        "known": ["mass[carriage]", "actuator_delay[drive]"],
    }  # fmt: skip
    rng = np.random.default_rng(0)
    system = system_of(write_case(tmp_path / "case", model, [driven(rng, 0.5), driven(rng, 1.1)], nominal))
    fitter = Fitter(system, system.simulator(threads=1), measure(system))
    by_name, as_believed = {c.name: c for c in system.vocabulary}, fitter.fit(NONE, [0, 1])
    explanation = Explanation(tuple(by_name[name] for name in found))
    fit = fitter.fit(explanation, [0, 1], near=as_believed, iterations=20)
    best = contend(fitter, fit, sensitivities(fitter, fit, directions(system)))
    sensitivities(fitter, as_believed, directions(system))  # what other effects do beside it is no answer to this
    said = contradicted(Search((best,), as_believed), fitter)
    assert ("known, and yet" in said) is false
    assert ("body 'carriage' is heavier than in the model (2.000" in said) is false
