"""Where the gap lies: short windows and their tests, disturbances with a date, what a missing force looks like."""

from __future__ import annotations

from dataclasses import dataclass

from runner.settings.declared import setting


@dataclass(frozen=True)
class WhereSettings:
    """Excess over the noise in short windows, and its shares."""

    window_lengths_s: tuple[float, ...] = setting(
        (0.25, 0.5, 1.0),
        "s",
        "Each twice as long: a longer one is less local and sees smaller effects, so it is taken where a shorter sees "
        "none.",
    )
    min_windows: int = setting(
        8, "windows", "Of fewer windows each has a good part of the whole: there is nothing to share out."
    )
    significance: float = setting(
        0.01, "probability", "In one recording of a hundred something is found where there is only noise."
    )
    false_discovery_rate: float = setting(
        0.05,
        "probability",
        "Of the cells that are said to stand out one in twenty may do so by chance (Benjamini & Hochberg).",
    )
    as_much_share: float = setting(
        0.5, "of the largest share", "A channel that misses half as much as another is no better than that one."
    )
    noise_variance_share: float = setting(
        0.06,
        "of the noise's variance",
        "The level of the noise is known to three per cent: what such an error makes of it is no gap yet.",
    )
    min_rest_values: int = setting(
        30, "values", "The variance of fewer values at rest is known to no better than a quarter, the root of 2/30."
    )
    permutations: int = setting(
        3999, "orders", "A chance of 0.05 is known to 0.0035 then, and the least that can be told is 0.00025."
    )
    block_windows: int = setting(
        4, "windows", "What is missing lasts longer than a window, so that neighbours are no independent witnesses."
    )
    force_error_share: float = setting(
        0.25,
        "of the prior's width",
        "A missing force that is known no better is not known: the prior says nearly as much.",
    )
    force_step: float = setting(
        0.03,
        "of the usual force",
        "By so little a force is changed to see what it does: friction neither starts nor stops a body by it.",
    )
    max_force: float = setting(
        3.0, "times the usual force", "The prior of a missing force: one that is larger would be the largest that acts."
    )
    just_after_s: float = setting(
        0.1, "s", "A drive, and what is compliant, still answers a change of command so long after it."
    )
    command_change: float = setting(
        0.2, "of the largest command", "A step of the command that is smaller is part of how it varies."
    )
    horizon_searched: float = setting(
        3.0,
        "times what is searched",
        "More of a long recording costs in proportion, and hardly moves the root mean square of so much.",
    )
    horizon_min_windows: int = setting(
        50, "windows", "The root mean square of so many is known to a tenth, the root of 1/100."
    )


@dataclass(frozen=True)
class DisturbanceSettings:
    """What pushed once, and is in no log."""

    window_s: float = setting(
        0.2, "s", "A push by hand lasts as long; in a shorter window no force shows beside the noise."
    )
    overlap: int = setting(
        8, "windows", "A beginning or an end is dated to a fraction of a window when so many windows see it."
    )
    margin: int = setting(3, "windows", "What is usual has to be seen to either side of a disturbance.")
    max_count: int = setting(
        8, "disturbances", "More of them in one recording are no accidents: it is the explanation that is wrong."
    )
    min_surprise: float = setting(
        2.0, "usual forces", "Six of seven windows lack less, so that a run of more begins and ends where a push does."
    )


@dataclass(frozen=True)
class LikenessSettings:
    """What a missing force goes along with, where no effect explains it."""

    min_windows: int = setting(
        20, "windows", "A shape has up to a few columns, each of which a window's worth of data is spent on."
    )
    significance: float = setting(
        0.001,
        "probability",
        "Some dozen shapes are tried for each force: one in a hundred of them then has a shape that is not there.",
    )
    min_share: float = setting(
        0.1, "of the mean square", "A reader who looks for what does less of a missing force finds nothing."
    )
    frequencies: int = setting(
        200, "frequencies", "From one beat in an episode to one in two windows, so many are some per cent apart."
    )
