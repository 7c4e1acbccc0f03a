"""Where no effect explains the gap: what to look at, from where the gap stands out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from runner.effects.wording import percent
from runner.settings import SETTINGS
from runner.systems.channels import Space

if TYPE_CHECKING:
    from runner.localise.where import Where
    from runner.systems.base import AbstractSystem

MOST_OF_IT = 0.5  # share of the excess from which on a channel is named alone

# what a cluster of the gap suggests, by the beginning of its factor or, for a regime, by what it says
OF_REGIMES = {
    "change of command": "Check that commands and measurements share one clock, and whether the actuator does what it "
    "is told at once: a delay, a ramp, backlash.",
    "at rest": "Check the sensor: what is at rest should show nothing but its noise.",
    "stuck": "Check what holds it: friction at rest, a stop, a cable.",
    "break": "Check what holds it: friction at rest, a stop, a cable.",
    "revers": "Check for backlash, and for friction that depends on the direction.",
    "satur": "Check the limits of the actuators.",
    "turning": "Check where the force acts, and what the base stands on: on its corners (`contact: corners`), as in "
    "plain MuJoCo, a body turns less easily than on all of its base.",
}
OF_FACTORS = {
    "place": "Look at what is there: another surface, an obstacle, a cable that pulls.",
    "heading": "Look for what acts in one direction: a slope, a cable, a draught, an asymmetric drive.",
    "direction": "Look for what acts in one direction: gravity, a cable, an asymmetric drive.",
    "speed": "Look for a resistance that changes with speed: lubrication, drag, a controller that falls behind.",
    "time": "Look for what changes in the course of an episode: warming up, wear, a clock or a sensor that drifts.",
    "episode": "Find out what was different then, and diagnose the recording without it.",
    "joint": "Look at that joint: its drive, its bearing, its cable, the calibration of its encoder.",
    "load": "Look for what depends on load: friction in gears and bearings, a link or a drive that yields.",
    "position": "Look at what is there: a stop, a cable, a part that binds.",
}
OTHERWISE = "Look for what acts only then."
OF_CHANNEL = "Check how that is measured: its calibration, its time stamps, its filter."
# what measures an orientation measures all of it: it has no axis of its own to be wrong about, a body has
OF_ORIENTATION = (
    "All axes of an orientation come from one measurement, which is seldom wrong about one alone: look for a torque on "
    "the body that the model lacks, or a mass that is spread otherwise."
)


@dataclass(frozen=True)
class Suspect:
    """A cluster of the gap: where it is, and what to look at there, a sentence each; its factor and cell, or None."""

    where: str
    advice: str
    cell: tuple[str, str] | None = None


def suspects(system: AbstractSystem, where: Where) -> tuple[Suspect, ...]:
    """Return what stands out, at most three: in what was done, in where, when or how fast, and in one channel."""
    if not where.exceeds:
        return ()
    rows, level = where.cells.to_dict("records"), SETTINGS.where.false_discovery_rate
    standing = [r for r in rows if r["factor"] != "channel" and r["q"] < level and r["lift"] > 1]
    out = []
    for activity in (True, False):
        these = [r for r in standing if (r["factor"] in system.activities) is activity]
        if these:
            # as in the sentence of where the gap is: what is rarer by chance first, then what has more of it
            out.append(_of_cell(system, min(these, key=lambda r: (r["p"], -r["share"]))))
    channels = [r for r in rows if r["factor"] == "channel" and r["q"] < level and r["share"] > MOST_OF_IT]
    return (*out, *(_of_channel(system, r) for r in channels))


def _of_cell(system: AbstractSystem, row: dict[str, Any]) -> Suspect:
    factor, cell = str(row["factor"]), str(row["cell"])
    known = OF_REGIMES if factor == "regime" else OF_FACTORS
    advice = next((text for word, text in known.items() if word in (cell if factor == "regime" else factor)), OTHERWISE)
    return Suspect(
        f"The gap is largest {system.phrase(factor, cell)}: {percent(row['share'])} of it, in {percent(_even(row))} of "
        "the time.",
        advice,
        (factor, cell),
    )


def _of_channel(system: AbstractSystem, row: dict[str, Any]) -> Suspect:
    channel = next(c for c in system.channels if c.name == row["cell"])
    return Suspect(
        f"It shows in the {channel.label} above all: {percent(row['share'])} of it.",
        OF_ORIENTATION if channel.space is Space.ROTATION else OF_CHANNEL,
    )


def _even(row: dict[str, Any]) -> float:
    """Return the share of the windows that a cell has."""
    return float(row["share"] / row["lift"])
