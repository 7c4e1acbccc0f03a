"""What to do next, once a diagnosis has said what it found."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from runner.diagnosis.corrected import FILE, folder_of
from runner.effects.wording import listed
from runner.report import words
from runner.report.statement import Kind, Left, Statement, state
from runner.report.suspects import suspects
from runner.settings import SETTINGS

if TYPE_CHECKING:
    from runner.diagnosis.result import Diagnosis, Ranked
    from runner.systems.base import AbstractSystem

SURE = 0.9  # an answer less likely than this asks for more data
ROUNDED = 0.01  # of a probability: less is the same in words
PIN_PATH = (
    "Where an arm or a hand decides the motion, record the path of what pushes, too, and state it as a `pin`: motion "
    "then follows the path, and the measured force is held against the force that this takes."
)


def replaying(folder: Path | None) -> str:
    """Return the command that replays another recording with the corrected model of this folder, None: wherever it is.

    It is run where the diagnosis was, not in that folder.
    """
    return f"runner gap NEW model={'FOLDER' if folder is None else shlex.quote(str(folder))}"


def next_steps(diagnosis: Diagnosis, folder: Path | None = None) -> list[str]:
    """Return what to do next, most useful first, one or two sentences each.

    Args:
        diagnosis: What was found.
        folder: Where that is written to; None: nobody knows.
    """
    said = state(diagnosis)
    if said.kind is Kind.NONE:
        steps = [
            "Keep your model. Nothing in this recording asks for a change of it.",
            "Should it miss elsewhere, record what you care about: other speeds, loads, places.",
        ]
        if remedy := diagnosis.system.solver_remedy(()):
            steps[0] = f"Keep your model but for how it is solved. {remedy}"
    elif said.kind is Kind.UNKNOWN:
        steps = _suspicions(diagnosis)
    else:
        steps = _corrections(diagnosis.system, said.top, open_answer=said.kind is Kind.OPEN)
        if others := words.equals(said.top):
            steps.insert(0, _decision(said.top, others, diagnosis.next_push, folder))
    if diagnosis.flights is not None:
        steps.insert(0, diagnosis.flights.advice)
    if said.left is Left.DRIVE:
        steps.insert(0 if said.kind is Kind.OPEN else len(steps), PIN_PATH)
    if diagnosis.next_push and not any(diagnosis.next_push in step for step in steps):
        steps.append(diagnosis.next_push)
    commanded = diagnosis.system.commanded
    # each effect beside the first leaves so much to what has no name, however much is recorded
    most = SETTINGS.probability.max_unknown ** max(len(said.top.effects), 1)
    unsure = said.top.probability < min(SURE, most - ROUNDED)
    varied = "with stronger and more varied commands" if commanded else "that differ more from each other"
    so_far = "This is not settled" if said.kind is Kind.OPEN else "The answer is likely, not certain"
    more = f"{so_far}: record more episodes, {varied}, and diagnose all of them together."
    again = f"Record again, {'other commands' if commanded else 'other motions'} than before, and"
    check = f"let the corrected model predict them: `{replaying(folder)}` {_to_be_expected(said)}"
    if said.kind is Kind.FOUND:
        steps.append(f"{more} Before that, {check}" if unsure else f"{again} {check}")
    elif unsure:
        steps.append(more)
    return steps


def _to_be_expected(said: Statement) -> str:
    """Return what a corrected model should miss of another recording."""
    if said.left is Left.NOISE:
        return "should show the noise and no more."
    if said.left is Left.SMALL_ERRORS:
        return "should show no more than what is left here."
    if said.left is Left.DRIVE:
        return "should show no more than the noise of the measured force makes, but where a motion hangs on a hair."
    return "will show what is left here too, as long as its cause is not found."


def _suspicions(diagnosis: Diagnosis) -> list[str]:
    """Return what to look at where no effect explains the gap."""
    found = suspects(diagnosis.system, diagnosis.where)
    return [
        *(f"{s.where} {s.advice}" for s in found),
        "Look below at where and when the simulator misses, and at the force that is missing: they are the best hint "
        "at its cause.",
        f"Check the recording itself: time stamps, axes, calibration, whether anything touched the "
        f"{diagnosis.system.noun}.",
    ]


def _decision(top: Ranked, others: Sequence[tuple[str, ...]], by: str | None, folder: Path | None) -> str:
    """Return what is to be decided before anything is changed, as no recording like this one does."""
    either = f"{words.title(top.effects)} and {listed([words.title(e) for e in others], 'or')}"
    by = by if by and by.startswith("To tell") else None
    how = f". {by}" if by else "; a measurement of another kind may."
    written = [] if folder is None else [f for o in others if (f := folder / folder_of(o) / FILE).is_file()]
    beside = listed([f"`{replaying(f.parent)}`" for f in written], "or")
    of_that = f" Of that `{replaying(folder)}` will miss less than {beside}, or the other way round."
    then = of_that if by and written else ""
    return f"Decide between {either}, which more recordings like this one can't tell apart{how}{then}"


def _corrections(system: AbstractSystem, top: Ranked, *, open_answer: bool) -> list[str]:
    """Return what to change in the simulator, and what to confirm by hand."""
    found, others = words.phrases(system, top), words.equals(top)
    together = system.remedies_together(top.values, top.errors)
    if not set(together) <= set(top.effects):
        together = {}  # what acts on all of a kind has a sentence of its own
    remedies = [together.get(e, p.remedy) for e, p in zip(top.effects, found, strict=True)]
    remedies.append(system.solver_remedy(top.values))
    take = (
        "Take the corrected model from the folder of this report: corrected.yaml is for `runner gap`; model.xml "
        f"{system.model_use(top.values)}."
    )
    if open_answer or others:
        trial = "To try the likeliest" if open_answer else f"Should it be {words.title(top.effects)}"
        take = f"{trial}: {take[0].lower()}{take[1:]}"
    steps = [take]
    if change := [r for r in dict.fromkeys(remedies) if r]:
        counted = change if len(change) == 1 else [f"({k}) {r}" for k, r in enumerate(change, 1)]
        steps.append(f"Or change your own model. {' '.join(counted)}")
    checks = [p.check for p in found if p.check]
    for names in others:
        # a check that speaks of the fitted values has none to speak of
        checks += [
            c for n in names if (c := words.phrase(system, n, {}, {}).check) and "?" not in c and c not in checks
        ]
    if checks:
        steps.append("Confirm it by hand. " + " ".join(checks))
    return steps
