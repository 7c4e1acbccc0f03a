"""The numbers of a diagnosis that nothing else gives: one value, `SETTINGS`, each number with its unit and a reason.
A squared noise is the variance of a channel's noise; an excess is what is left beyond that.

What a recording is held against, noise, inference, localising and the verdict read them from here and have no others of
their own. The reasons are physical, statistical or computational, and give a number's order of magnitude; within that,
its digits are a choice. A number by which stated probabilities or errors are made to hold is called a calibration.

What belongs to a kind of object (how far its simulator may be off, how much of a recording is searched) stands with its
system, the width of a prior with its effect. Three kinds of numbers stay beside their only use, as no verdict depends
on them: how much is held in memory at once, how much of a list is shown, and how iterations step that end where they
end anyway. `tests/test_settings.py` lists these and admits no others.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from runner.settings.fit import FitSettings
from runner.settings.held_out import BreakawaySettings, HeldOutSettings
from runner.settings.noise import NoiseSettings
from runner.settings.odds import OddsSettings, ProbabilitySettings
from runner.settings.plausible import CommandSettings, ForceSettings, MotionSettings, UnitSettings
from runner.settings.search import LeapSettings, PieceSettings, SearchSettings, StretchSettings
from runner.settings.where import DisturbanceSettings, LikenessSettings, WhereSettings


@dataclass(frozen=True)
class Settings:
    """All numbers of a diagnosis, by stage, in the order in which a recording meets them."""

    motion: MotionSettings = field(default_factory=MotionSettings)
    forces: ForceSettings = field(default_factory=ForceSettings)
    commands: CommandSettings = field(default_factory=CommandSettings)
    units: UnitSettings = field(default_factory=UnitSettings)
    noise: NoiseSettings = field(default_factory=NoiseSettings)
    fit: FitSettings = field(default_factory=FitSettings)
    stretches: StretchSettings = field(default_factory=StretchSettings)
    pieces: PieceSettings = field(default_factory=PieceSettings)
    search: SearchSettings = field(default_factory=SearchSettings)
    leap: LeapSettings = field(default_factory=LeapSettings)
    breakaway: BreakawaySettings = field(default_factory=BreakawaySettings)
    held_out: HeldOutSettings = field(default_factory=HeldOutSettings)
    odds: OddsSettings = field(default_factory=OddsSettings)
    probability: ProbabilitySettings = field(default_factory=ProbabilitySettings)
    where: WhereSettings = field(default_factory=WhereSettings)
    disturbance: DisturbanceSettings = field(default_factory=DisturbanceSettings)
    likeness: LikenessSettings = field(default_factory=LikenessSettings)


SETTINGS = Settings()
