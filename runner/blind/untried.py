"""What made cases of each kind of system do not try, as a page of scores says it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

BOX = (
    "What this set does not try: between a null case, whose uneven floor and slightly wrong size move the recording by "
    "about 0.4 noises each at most, and a subtle effect there is nothing, and the mass, friction and centre of mass of "
    "a null case are exactly as believed. The body and its integrator are not the simulator's, but most laws of "
    "friction have the same form; patches, pressures and the anisotropy differ in kind. Episodes whose outcome hangs "
    "on a hair are drawn anew, up to 60 times."
)
DRAKE_BOX = (
    "What this set does not try: friction that differs along two axes, which Drake's contact does not have; episodes "
    "in which it moves a box without any effect otherwise than the equations of motion do, by more than half a noise, "
    "are drawn anew. But for friction, an effect has the form that the vocabulary gives it. A null case may be "
    "moved by several noises through its sizes, its floor and the timing of its pushes."
)
DRAKE_BODY = (
    "What this set does not try: pushes; bodies that are no cube, box or cylinder; contacts of another kind than "
    "linear springs, Coulomb's cone and a convex solver; the course of a toss after the engines part, soon after its "
    "first touch: without any effect they do not differ by more than half a noise in an episode, which is cut there "
    "or drawn anew. An effect that the vocabulary has a word for has the form that it has there."
)
MECHANISM = (
    "What this set does not try: besides what is planted, the mechanism is exactly as believed, so that between a null "
    "case and a subtle effect there is nothing. The equations of motion and the integrator are not the simulator's, "
    "but an effect that the vocabulary has a word for has the form that it has there. Hinges stay below 150 degrees; "
    "episodes whose outcome hangs on a hair are drawn anew, up to 40 times."
)


def untried(answers: Iterable[Mapping[str, Any]]) -> str:
    """Return what the cases of these answers do not try; answers without a word of their system are of boxes."""
    systems = {answer.get("made", {}).get("system", "planar_box") for answer in answers}
    return " ".join(
        text
        for text, fits in (
            (BOX, "planar_box" in systems),
            (DRAKE_BOX, "planar_box_drake" in systems),
            (DRAKE_BODY, "free_body_drake" in systems),
            (MECHANISM, systems - {"planar_box", "planar_box_drake", "free_body_drake"}),
        )
        if fits
    )
