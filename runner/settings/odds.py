"""How explanations are weighed against each other, and what is stated of that as a probability."""

from __future__ import annotations

from dataclasses import dataclass
from math import log, sqrt

from runner.settings.declared import setting


@dataclass(frozen=True)
class OddsSettings:
    """Priors of the evidence, and what speaks against effects that are in no need of being there."""

    mismatch_share: float = setting(
        0.01,
        "of an effect's usual size",
        "What is known by a ruler, a scale or a protractor is off by a per cent; how many of them a system's simulator"
        " is off is estimated.",
    )
    rough_form_share: float = setting(
        0.25,
        "of an effect's usual size",
        "No ruler tells how a hit goes on, and engines have other laws for it (springs, dashpots, impulses): the same "
        "number in two of them does the same to about a quarter.",
    )
    texture_share: float = setting(
        0.02,
        "of a patch's amplitude",
        "Patches differ from their surroundings by 0.2, and any surface is uneven by 0.4 % from place to place.",
    )
    effect_log_odds: float = setting(
        15.0,
        "log odds against each effect",
        "Several causes at once are rare, and a slightly wrong form looks like another effect, with thousands of "
        "samples to its credit.",
    )
    outside_log_odds: float = setting(
        10.0, "log odds", "What has no name in the vocabulary is met less often than what has one."
    )
    visible_noises: float = setting(
        1.0,
        "standard deviations of the noise",
        "What moves no channel by more is hidden in what its sensor adds; two motions further apart have parted.",
    )
    told_log_odds: float = setting(
        100.0,
        "log odds",
        "However log odds are tempered, an explanation further behind the likeliest has no share in what is told.",
    )
    rejection_log_odds: float = setting(
        1000.0,
        "log odds",
        "An effect that lacks all of what is asked of it is as good as ruled out; one that lacks a little is little "
        "less likely, as its errors are estimates.",
    )
    compared_effects: int = setting(
        30, "effects", "The best of so many that are not there stands out by chance; a vocabulary has about as many."
    )
    form_error_ratio: float = setting(
        10.0, "times what is left", "An order of magnitude is what no other form of the same effect takes off."
    )
    even_gap_excess: float = setting(
        0.3,
        "squared noises",
        "Residuals a seventh larger than the noise are as likely small errors of a simulator as an effect.",
    )
    log_odds_per_efold: float = setting(
        6.0,
        "log odds",
        "What small errors of a simulator add up to has no heavy tail: twice the gap is 64 times as likely an effect.",
    )
    visible_gap_excess: float = setting(
        1.5,
        "squared noises",
        "More than the noise's own variance is left beyond it: that has a cause, however many small errors could do "
        "the same.",
    )
    worse_log_odds: float = setting(
        1000.0,
        "log odds per squared noise",
        "A squared noise is that of thousands of samples: an effect that takes the simulator away from them is none.",
    )
    max_worse_log_odds: float = setting(
        100.0, "log odds", "An accident in an episode left out must not outweigh all that the fitted ones say."
    )
    confounded_min_alike: float = setting(
        0.6,
        "share of squares",
        "An effect of which a rival could do less leaves most of itself plain, and needs no trial.",
    )
    confounded_trials: int = setting(
        3, "effects", "The most alike are tried; each costs two fits, and a reader needs no long list."
    )
    drive_draws: int = setting(
        16, "replays", "A standard deviation of sixteen is known to a fifth, and odds turn with its logarithm."
    )
    told_apart_log_odds: float = setting(
        5.0, "log odds", "150 to 1: strong evidence on every scale of it (Jeffreys 1961)."
    )

    one_motion_share: float = setting(
        1e-3,
        "of the squares of what they do",
        "Two words for one motion agree to what descents leave; two causes that are merely alike differ by some per "
        "cent of what they do, which is thousandths of its squares.",
    )

    @property
    def min_errors_alone(self) -> float:
        """Standard errors by which one effect has to stand out: a number takes off two units of loss (Akaike 1974)."""
        return sqrt(2.0)

    @property
    def min_errors_beside_others(self) -> float:
        """The same of each of several: more than the best of many that are not there (Foster & George 1994)."""
        return sqrt(2.0 * log(self.compared_effects))


@dataclass(frozen=True)
class ProbabilitySettings:
    """From log odds and what is left to probabilities, `none` and `unknown` among them."""

    temperature: float = setting(
        2.0,
        "divides log odds",
        "Calibration: samples are not as independent, and explanations not as exact, as a likelihood has them.",
    )
    unknown_excess: float = setting(
        0.12,
        "squared noises",
        "Residuals are 6 % larger than the noise then, and the noise is known no better: nothing may be going on "
        "beside the explanation, or something.",
    )
    chance_errors: float = setting(
        2.0, "standard errors", "A mean square of few values scatters: what lies within two of its errors is chance."
    )
    unknown_log_width: float = setting(
        0.4,
        "logarithm of an excess",
        "Calibration: what an explanation may leave is known to a factor of about one and a half.",
    )
    min_unknown: float = setting(
        0.03,
        "probability",
        "Some of what has no name looks like what has one, however well that fits, and so may each effect of several:"
        " an answer of one is no surer than 0.97, of two than 0.94.",
    )
    failed_unknown: float = setting(
        0.7,
        "probability",
        "Calibration: where most of a plain gap is left in unseen episodes, two to one that something else is at work.",
    )
    strained_log2_level: float = setting(
        2.5,
        "binary logarithm",
        "A simulator that has to be off by six per cent of everything is not off by that: it makes up for an "
        "explanation.",
    )
    strained_width: float = setting(
        0.25, "binary logarithm", "Calibration: a quarter of the distance of two levels of mismatch."
    )
    strained_excess: float = setting(
        0.05, "squared noises", "Where the explanation alone leaves less, mismatch has nothing to make up for."
    )
    strained_log_width: float = setting(
        0.3, "logarithm of an excess", "Calibration: what an explanation alone may leave is known to about a third."
    )
    equal_share: float = setting(
        0.05,
        "of the likeliest of a group",
        "An explanation less likely than a twentieth of another is not its equal, though such recordings can't tell "
        "them apart.",
    )
    mismatch_error_factor: float = setting(
        0.8,
        "of a standard error",
        "Calibration: every parameter is charged all of the mismatch, which they share, so that errors come out too "
        "large by a quarter.",
    )
    noteworthy: float = setting(
        0.02,
        "probability",
        "An explanation less likely than one in fifty needs no sentence, and no experiment against it.",
    )

    @property
    def max_unknown(self) -> float:
        """Beside which the best explanation, and each effect of several, keeps what `unknown` keeps beside it."""
        return 1.0 - self.min_unknown
