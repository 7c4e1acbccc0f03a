"""How a force that nothing foretells is allowed for."""

from __future__ import annotations

from dataclasses import dataclass

from runner.settings.declared import setting


@dataclass(frozen=True)
class ProcessSettings:
    """A force that is in no log and no model, integrated out of what explanations are held against."""

    interval_s: float = setting(
        0.5, "s", "What lasts shorter moves a body little, and what lasts longer is the sum of some; each costs runs."
    )
    scales: tuple[float, ...] = setting(
        (0.0001, 0.0002, 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
        "of the usual force",
        "From what a simulator rounds off to as much as acts at all, all equally likely: what is left tells.",
    )
    difference_share: float = setting(
        0.01, "of the usual force", "So small a force answers in proportion, and its answer stands out of rounding."
    )
    sure_log_odds: float = setting(
        2.0,
        "log odds",
        "Two standard errors, squared and halved: a force is as small as it may be for all that is seen.",
    )
