"""How noise is told from motion, in what a model leaves or an object at rest shows."""

from __future__ import annotations

from dataclasses import dataclass

from runner.settings.declared import setting


@dataclass(frozen=True)
class NoiseSettings:
    """Level and colour of the measurement noise."""

    window_s: float = setting(
        0.5,
        "s",
        "Over half a second a motion, or what a model does wrong, is close to a cubic; noise is not, be it white or "
        "what the filter of a tracking system leaves.",
    )
    max_window_samples: int = setting(
        64,
        "samples",
        "A window is a full covariance matrix, of which each step of the likelihood takes the cube; more samples "
        "hardly tell more of noise that forgets within some of them.",
    )
    smooth_degree: int = setting(
        3,
        "degree",
        "Where a force changes evenly over a window, the motion is a cubic: what one follows is the model's doing, "
        "what none follows is noise.",
    )
    min_samples: int = setting(
        300, "samples", "Their variance is known to 8 % (the root of 2/300); of fewer no colour can be told."
    )
    min_lag_one: float = setting(
        0.1,
        "correlation",
        "With less from one sample to the next, standard errors are too small by less than a tenth if it is ignored.",
    )
    colour_loss: float = setting(
        25.0,
        "twice a log likelihood",
        "Five standard errors, squared: colour widens every standard error that follows, so it has to be beyond doubt.",
    )
    min_variance: float = setting(
        1e-18,
        "(m, rad, m/s, rad/s)²",
        "A nanometre, squared, which no sensor reaches: a channel that never moves at rest must not have an infinite "
        "likelihood.",
    )
    max_window_power: float = setting(
        3.0,
        "times the median",
        "The power of eight terms of noise scatters by half of its mean: three times as much is four standard "
        "deviations off, and holds a knock.",
    )
    slow_terms: int = setting(
        8,
        "polynomials",
        "What a push that is in no log leaves of a window is in the slowest terms beyond the cubic, and hardly shows "
        "in the power of all of them.",
    )
    min_memory_s: float = setting(
        0.006,
        "s",
        "Noise that forgets faster than that is white from one sample to the next, at the usual rates of 60 to 250 Hz.",
    )
    outlier_sigmas: float = setting(
        6.0, "standard deviations", "Of a hundred million values of normal noise not one is so far off."
    )
    stated_log_error: float = setting(
        0.5,
        "standard deviation of a logarithm",
        "What a data sheet states is the noise of some range and rate, and off by a factor of 1.6 as a rule.",
    )
    material_log_change: float = setting(
        0.05,
        "logarithm of a level",
        "Standard errors change by as much, a twentieth; for less, everything would be fitted again for nothing.",
    )

    odd_episode_ratio: float = setting(
        3.0,
        "times the median",
        "Flights into impacts differ by about as much from one to the next in what a model leaves; what leaves "
        "more went elsewhere.",
    )

    @property
    def max_memory_s(self) -> float:
        """Half a window: over a longer memory noise is as smooth as the cubic that is taken for motion."""
        return 0.5 * self.window_s
