"""Which explanations are tried: in pieces of episodes first, then one effect after the other, or several at once."""

from __future__ import annotations

from dataclasses import dataclass

from runner.settings.declared import setting


@dataclass(frozen=True)
class StretchSettings:
    """Over how long a model responds in proportion to a small force."""

    small_force: float = setting(
        0.01,
        "of the usual force",
        "A response to so little is in proportion unless something is about to slip, or to tip.",
    )
    large_force: float = setting(
        0.1, "of the usual force", "Who is a tenth off in a force must still be near enough for a comparison."
    )
    max_bent: float = setting(
        0.2,
        "of the response",
        "Linear sensitivities, and standard errors from them, bear to be a fifth off in half of the windows.",
    )
    max_bent_of_one: float = setting(
        0.5,
        "of the response",
        "Of one part by itself: where half of what a force does is out of proportion, a step along it leads anywhere; "
        "where less is, a descent finds its way, and a longer part shows more.",
    )
    max_strayed: float = setting(
        0.5,
        "of the motion",
        "A force that is a tenth off leads away by half of all motion where a stretch is too long to compare.",
    )
    probed_windows: int = setting(
        24, "windows", "A median over so many is known to a fifth of their spread; each costs simulations."
    )
    same_clock: float = setting(
        1.1, "times the shortest period", "Windows of as many samples are then equally long to a tenth."
    )


@dataclass(frozen=True)
class PieceSettings:
    """A first look at episodes cut into pieces (multiple shooting)."""

    hopeless_mean_square: float = setting(
        1000.0,
        "mean square in noises",
        "What comes no nearer than thirty times how samples differ is not explained by sets of the same effects: the "
        "noise is then told from what the model leaves at once, instead of after a search that ends there.",
    )
    far_mean_square: float = setting(
        2.5,
        "mean square in noises",
        "What the nominal model misses outweighs the noise there, so that descents from it may end in local minima.",
    )
    count: int = setting(
        8,
        "pieces per episode",
        "What a wrong force does to a position grows with the square of time: in an eighth it is a 64th of the whole.",
    )
    min_length_s: float = setting(
        0.5, "s", "Over less, the start state that is free in every piece takes up most of what a wrong force does."
    )
    most_growth: float = setting(
        10.0,
        "noises",
        "Where one noise of the place that a motion begins at grows to more, whatever is a little off becomes as large "
        "as the motion, and a descent of start states ends in any of many hollows.",
    )
    beginning: float = setting(
        0.5,
        "of the longest stretch",
        "Stretches too short to be cut are looked at so far: of a flight into an impact, that is mostly the flight.",
    )
    max_mean_square_ratio: float = setting(
        0.5,
        "of that of whole episodes",
        "Where pieces leave more, errors do not pile up over time: descents go as well from the whole, and pieces show"
        " nothing that it does not.",
    )
    searched_share: float = setting(
        0.5,
        "of the pieces",
        "Pieces of which the nominal model leaves least say nothing of what it lacks, and cost as much as the others.",
    )
    growing_shares: tuple[float, ...] = setting(
        (0.5, 0.75),
        "of an episode",
        "Errors grow with the square of time, to about twice as much from each length to the next: each fit begins in "
        "the valley that the one before has found.",
    )
    whole_steps: int = setting(6, "steps", "The fit to the whole begins in its valley, and the search goes on from it.")
    min_stretches: int = setting(
        4, "stretches", "Fewer than that may all lie where the object did one and the same thing."
    )
    surprise_ratio: float = setting(
        3.0,
        "times the median, mean square in noises",
        "By that much more is missed where something acts that does not act elsewhere; how fast an object moves makes "
        "less of a difference.",
    )
    unexplained_share: float = setting(
        0.2,
        "of what is searched otherwise",
        "Where nothing explains even pieces of a second, what is missing is plain in a part of the recording.",
    )


@dataclass(frozen=True)
class SearchSettings:
    """Forward selection with a beam."""

    min_gain_excess: float = setting(
        0.03,
        "squared noises",
        "A simulator of the right form with sizes off by some tenths of a per cent leaves as much: an effect that "
        "takes off less is not worth a name.",
    )
    min_gain_share: float = setting(
        0.004,
        "of the nominal excess",
        "A model's form is right to some six per cent of what an effect does; the square of that remains, and has no "
        "cause of its own.",
    )
    near_excess: float = setting(
        0.5,
        "squared noises",
        "Residuals are less than a quarter larger than the noise there: the fit is in the valley of what is going on, "
        "linear models hold and descents end where they should.",
    )
    negligible_excess: float = setting(
        0.1,
        "squared noises",
        "Residuals are five per cent larger than the noise then, and the noise is hardly known better: it is as good "
        "as nothing.",
    )
    beam_width: int = setting(
        2,
        "explanations",
        "Where one effect stands in for another, the other is second as a rule; the cost grows in proportion.",
    )
    most_promising: int = setting(
        5,
        "effects",
        "Where linear promises hold, the right effect is among the first few, and each further one costs a fit.",
    )
    candidates: int = setting(
        8, "effects", "Where promises hold less, as beside a first effect, the right one is further down the list."
    )
    comparable_promise: float = setting(
        0.5,
        "of the most promising",
        "A linear model is off by a factor of two where much is missing, so that of many joints alike not the eighth "
        "ends the list; a fit that comes nowhere near is given up after a step.",
    )
    nonlinear_candidates: int = setting(
        12,
        "effects",
        "Of an effect with which the motion jumps a promise says little: all of a small vocabulary are tried, the "
        "first of a machine with many joints.",
    )
    compared: int = setting(
        7,
        "explanations",
        "An effect far down in what it leaves is not first in evidence; each that is compared costs an integral over "
        "all mismatch.",
    )
    expansion_log_odds: float = setting(
        1000.0,
        "log odds",
        "One more effect may make up for any distance to the likeliest but one of another order of magnitude.",
    )
    settled_share: float = setting(
        0.03,
        "of the nominal excess",
        "The leader has explained the gap to within what a slightly wrong form of it leaves: nothing else is worth "
        "adding to.",
    )
    lead_ratio: float = setting(
        3.0,
        "times what is left",
        "An explanation that leaves three times as much as a larger set will not reach it with one effect more.",
    )
    leap_lead_ratio: float = setting(
        1.5,
        "times what is left",
        "A leap that led to the larger set has tried what to add to the smaller ones: half as much again is enough.",
    )
    min_promise_share: float = setting(
        0.25,
        "of what an effect is worth",
        "A linear promise may be too low by some times; an effect that promises less than that is not worth a name.",
    )
    lag_gains: float = setting(
        5.0, "gains that are worth an effect", "A longer descent does not make up for what five effects have to gain."
    )


@dataclass(frozen=True)
class LeapSettings:
    """Several effects at once, by stepwise regression in the linear model."""

    max_leaps: int = setting(
        4,
        "leaps",
        "Each leap begins where the one before has been fitted, so that a few of them reach a vocabulary's most.",
    )
    max_effects: int = setting(
        3, "effects", "With more at a time a leap goes farther from the fit around which the linear model holds."
    )
    steps: int = setting(10, "steps", "The fit begins where the linear model puts it.")
    free_spread: float = setting(
        1e2,
        "prior widths",
        "It is large against every amplitude, while its square, which is added and taken out again, leaves the digits "
        "of the rest.",
    )
    min_gain_per_number: float = setting(
        0.03,
        "of what is left",
        "A further number of its own for each of a kind has to take off more than a slightly wrong form leaves.",
    )
