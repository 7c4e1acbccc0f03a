"""What a recording can be: beyond these numbers it is refused, or a line says what is odd about it."""

from __future__ import annotations

from dataclasses import dataclass

from runner.settings.declared import setting


@dataclass(frozen=True)
class MotionSettings:
    """Positions and velocities of one thing: the first are the integral of the second."""

    min_samples: int = setting(
        50, "samples", "Fewer than fifty values may all be the same by rounding, or because nothing was done yet."
    )
    moved_half_sizes: float = setting(
        0.05, "half sizes", "A body that has moved by less has hardly moved: signs and axes can't be told from that."
    )
    moved_rad: float = setting(0.1, "rad", "Some six degrees: a tracking system's errors of angles are far below that.")
    moved_m: float = setting(0.02, "m", "The same of a slide: a tenth of a radian at the end of a lever of 0.2 m.")
    spike_half_sizes: float = setting(
        0.02, "half sizes", "A lone sample that is off by less than a fiftieth of the body's size does no harm."
    )
    spike_rad: float = setting(0.02, "rad", "A lone sample of an angle that is off by about a degree does no harm.")
    spike_share: float = setting(
        0.5, "of the least motion", "A lone sample of a joint has to be off by half of what counts as motion at all."
    )
    lone_factor: float = setting(
        50.0, "times what is usual", "Noise of heavy tails has samples fifteen times as far off as is usual, not fifty."
    )
    lone_tolerance: float = setting(
        0.25, "of what it is off", "A lone sample puts both neighbours off by half as much, give or take their motion."
    )
    answer_s: float = setting(
        0.2, "s", "A velocity that was filtered tells of a change of position by a fifth of a second later."
    )
    stuck_samples: int = setting(
        10, "samples", "A slow body repeats a rounded value some times: ten in a row are a channel that sticks."
    )
    stuck_runs: float = setting(
        5.0, "times the usual", "A sensor that is slower than the samples repeats each value, always about as often."
    )
    stuck_speed_share: float = setting(
        0.2, "of the rms velocity", "What is missed meanwhile must be motion, and not a body that goes at a crawl."
    )
    usual_percent: float = setting(
        99.0,
        "percent",
        "What is usual is what all but a hundredth stay below: a fault of some samples does not move it.",
    )
    step_factor: float = setting(
        5.0, "times what is usual", "No motion goes five times as far in one sample as in nearly all others, and stops."
    )
    noise_variance_ratio: float = setting(
        0.5,
        "of the variance",
        "White noise changes from sample to sample by twice its variance, a motion that is sampled at all by far less.",
    )
    apart_share: float = setting(
        0.5,
        "of the displacement's square",
        "If half of a displacement is no integral of the velocity, it is none at all.",
    )
    together_share: float = setting(
        0.1, "of the displacement's square", "Noise and offsets leave a tenth at most of what is plainly an integral."
    )
    min_correlation: float = setting(
        0.9, "correlation", "Two columns that go along with, or against, each other so closely are of one motion."
    )
    max_scale: float = setting(
        1.7, "times", "Bad clocks and calibrations are off by some per cent: 1.7 times is another unit or another axis."
    )
    scale_share: float = setting(
        0.03,
        "of a known factor",
        "Units differ by exact factors, which a gain of least squares gives to a few per cent.",
    )


@dataclass(frozen=True)
class ForceSettings:
    """Forces that push an object, and what its motion needs: mass times acceleration, and friction."""

    max_gain: float = setting(
        5.0, "times", "Nobody is wrong by a factor of five about a mass or a friction; units are by ten and more."
    )
    turned_deg: float = setting(
        45.0, "degrees", "Beyond half of a right angle forces are nearer to another axis than to their own."
    )
    block_s: float = setting(
        0.1, "s", "Means over a tenth of a second have little noise left, and a push lasts several of them."
    )
    min_blocks: int = setting(
        20, "blocks", "Two seconds of sliding under a force are needed to fit two axes, signs and a constant."
    )
    latest_s: float = setting(
        0.5, "s", "No drive answers its command later than by half a second; a log may be late by as much."
    )
    sliding_m_s: float = setting(
        0.05, "m/s", "Below that the direction of the motion, and so of friction, is lost in noise."
    )
    max_constant: float = setting(
        0.25, "of the weight", "A slope of fourteen degrees pulls so much: no ground of an experiment is as steep."
    )
    max_reach: float = setting(
        2.0,
        "half diagonals",
        "Nobody is wrong by a factor of two about a body's size: beyond, a force acts on nothing.",
    )
    max_pin_depth: float = setting(
        0.1,
        "of the least half size",
        "A pin can't be in a body: sensors, and sizes that are a little wrong, put it there by some hundredths.",
    )
    least_noise: float = setting(
        0.001, "of the largest force", "Numbers of a table are rounded to less; no force sensor is better than that."
    )
    most_noise: float = setting(
        0.3,
        "of the force's root mean square",
        "A sensor of which a third is noise is read by nobody; a command that is random is as large as itself.",
    )
    held_share: float = setting(
        0.4,
        "of the samples",
        "A command that is held over two samples stays what it was at half of them; noise that is as small as the step"
        " of its sensor does so at less than a third.",
    )
    tone_correlation: float = setting(
        0.3,
        "correlation",
        "A sine has 0.7 in the mean over lags, white noise one over the root of its samples: a tenth in a hundred.",
    )
    explained_share: float = setting(
        0.3, "of what is needed", "Where a force explains less of the motion, its size and its sign say nothing."
    )
    unexplained_share: float = setting(
        0.2, "of what is needed", "Forces that explain less than a fifth of a motion that they made are not its forces."
    )
    plain_share: float = setting(
        0.6, "of what is needed", "Columns taken otherwise must explain well over half before a line says so."
    )
    axis_share: float = setting(
        0.4, "of the other axis", "An axis along which hardly anything is needed can't tell whether its force is right."
    )
    turning_share: float = setting(
        0.05, "of force times half size", "Smaller moments come of where exactly a finger touches, which nobody logs."
    )
    certain_errors: float = setting(
        5.0, "standard deviations", "Noise is beyond five standard deviations once in millions of values."
    )


@dataclass(frozen=True)
class CommandSettings:
    """Commands of a mechanism, and what its motion needs by the believed model."""

    smooth_s: float = setting(
        0.1, "s", "Accelerations of positions need a cubic over so long; what joints do lasts longer."
    )
    min_window_samples: int = setting(5, "samples", "A cubic has four numbers: with fewer samples nothing is smoothed.")
    later_share: float = setting(
        0.1, "of the answer", "A later answer has to explain a tenth more, or chance would choose among all delays."
    )
    min_points: int = setting(40, "points", "A gain from fewer points than forty, smoothed as they are, has no digits.")
    max_gain: float = setting(
        10.0,
        "times",
        "Gains and inertias of drives are believed to a factor of some; a weak servo follows by a quarter.",
    )
    unexplained_share: float = setting(
        0.15, "of the answer", "Gravity, springs and friction hide much of what a command does, but not six sevenths."
    )
    telling_share: float = setting(
        0.2, "of the answer's square", "A command that is small against all else that acts need not be seen."
    )
    beyond_factor: float = setting(
        20.0, "times what is usual", "Commands are limited by their drive: twenty times the usual is no command."
    )
    friction_speed_share: float = setting(
        0.1, "of the usual speed", "Where a joint turns round, dry friction changes its sign over about so much."
    )


@dataclass(frozen=True)
class UnitSettings:
    """Other units and axes: factors that no error of a model reaches."""

    max_travel_half_sizes: float = setting(
        1e3, "half sizes", "A hundred metres for a body of 0.1 m: a factor of 1000 is mm for m."
    )
    max_reach_half_sizes: float = setting(
        50.0, "half sizes", "A force acts on the body, within one half size or so; a place in mm is a thousand off."
    )
    max_froude: float = setting(
        30.0,
        "speed over the root of gravity times half size",
        "What is pushed or tossed stays below three; speeds in mm/s are a thousand times as high.",
    )
    max_speed_up: float = setting(
        20.0, "times what force and friction can do", "Errors of mass and friction make it some times, mm/s a thousand."
    )
    max_spin_up: float = setting(
        6.0, "times what force and friction can do", "Errors of an inertia make it twice as much, degrees/s 57 times."
    )
    spare_friction: float = setting(
        0.1, "coefficient", "On ground believed to be slippery the quotient would be one of noise by nothing."
    )
    body_share: float = setting(
        0.2, "of what is unexplained", "Another reading has to leave a fifth at most of what the stated one leaves."
    )
    ratio_share: float = setting(
        0.1, "of a known factor", "A ratio of rms values with noise in it is near to the factor of its unit by a tenth."
    )
    noted_ratio: float = setting(
        1.25, "times", "A quarter more is no unit, but no clock or scale that was set right either: worth a line."
    )
