"""The numbers by which a mechanism's recording is read and replayed, each with its unit and a reason.

As in `runner.settings`, which has those of every system. How joints and contacts are solved stands with the models
(`models`, `midpoint`, `simulator`), what is proposed or drawn where that is done.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from runner.settings.declared import setting


@dataclass(frozen=True)
class ReplaySettings:
    """Over how long, and in which steps, a model is replayed."""

    max_length_s: float = setting(
        8.0, "s", "Errors that pile up over longer tell nothing new, and cost as much as what does."
    )
    shared_length_s: float = setting(
        2.0, "s", "Where so many episodes share what is searched that each would get less, stretches may be this long."
    )
    max_impact_s: float = setting(
        0.4, "s", "A body that falls has several impacts in that time, and each adds what nobody knows."
    )
    min_impact_s: float = setting(0.1, "s", "One impact, and where the body goes from it, need as long.")
    max_bent_by_impacts: float = setting(
        0.25, "of the response", "Where impacts bend, half of the bodies that are hit answer in proportion for longer."
    )
    max_survey_step_s: float = setting(
        0.01, "s", "Contacts and drives of longer steps are not those of the model any more."
    )
    survey_change: float = setting(
        0.02,
        "of the response",
        "A survey asks how a prediction changes, and two per cent of that choose no other effect.",
    )
    max_step_s: float = setting(
        0.004, "s", "A motor's, or a servo's, closed loop of some tens of hertz is followed by such steps."
    )
    min_steps_per_sample: int = setting(
        3, "steps", "What happens between two samples, a contact or a step of the command, has its place."
    )
    step_change_noises: float = setting(
        0.1, "standard deviations of the noise", "An error of the step so small adds a hundredth to the squares."
    )
    step_error_noises: float = setting(
        1.0,
        "standard deviations of one reading",
        "Over all readings together: no number that is fitted is then off by more than its standard error, whatever it "
        "is.",
    )
    compared_episodes: int = setting(
        3, "episodes", "The longest ones show whether a step is too long, as its errors pile up."
    )
    even_clock: float = setting(
        1e-3,
        "of a period",
        "Samples so near to an even grid are on it: a thousandth is what time stamps are rounded to.",
    )
    harder_contact: float = setting(
        1.25, "times as stiff", "Nobody has measured how hard a contact is: a quarter more is as good a model."
    )


@dataclass(frozen=True)
class FlightSettings:
    """When a free body flies, and when it lies."""

    clearance: float = setting(
        0.03, "of a body's size", "Sizes and poses are known to about that: nearer it may touch."
    )
    max_length_s: float = setting(
        1.0, "s", "In which a body falls five metres: what acts in the air shows the more the longer it flies."
    )
    min_length_s: float = setting(
        0.05, "s", "Between two impacts a start rests on the flight alone: a shorter one is a rattle."
    )
    still: float = setting(0.02, "of a body's size", "A body that moves less until the end of an episode lies.")
    max_looked_at: int = setting(
        400,
        "samples of an episode",
        "Each costs a search for collisions; a longer episode is looked at on a thinner grid.",
    )
    rests: int = setting(
        8, "episodes", "One rest says as much as the next of how the ground leans and how high a body is."
    )


@dataclass(frozen=True)
class StartSettings:
    """The unknown start of a mechanism."""

    smooth_s: float = setting(
        0.05, "s", "Half the width of local polynomials: joints that are driven hardly jerk in a tenth of a second."
    )
    broad_rad: float = setting(1.0, "rad", "What nobody measured may be so far from its reference.")
    broad_m: float = setting(0.3, "m", "The same of what slides, within the reach of an arm.")
    broad_rate: float = setting(3.0, "rad/s or m/s", "And so fast, as fast as driven joints are.")
    slope_s: float = setting(
        0.03, "s", "A slope of positions over so short a window has the error of one of them over that time."
    )
    unmeasured_weight: float = setting(
        1e-6,
        "of its breadth",
        "What is not measured is held at its reference by so little that it takes nothing off what is.",
    )
    difference_of_size: float = setting(
        0.005,
        "of a body's size, and rad",
        "Smaller differences of starts tell which corner chatters, and not where the body goes.",
    )


@dataclass(frozen=True)
class SignalSettings:
    """What measured and commanded signals say of what goes on."""

    settle_s: float = setting(
        0.5, "s", "After a command has changed, a drive and a damped joint come to rest within as long."
    )
    min_rest_s: float = setting(
        0.3, "s", "Slow noise, of a quarter of a second at most, shows in a rest that is longer."
    )
    min_rest_samples: int = setting(8, "samples", "A trend with its standard error needs more than a few.")
    flat: float = setting(
        0.01, "of a channel's spread", "A joint at rest moves by next to nothing of what it moves otherwise."
    )
    still_errors: float = setting(
        4.0, "standard errors", "Of ten thousand rests hardly one has such a trend, or such a speed, by chance."
    )
    slow: float = setting(
        0.03,
        "of the usual speed",
        "A joint below that has no direction: noise, or a creep of its friction, may turn it.",
    )
    idle: float = setting(
        0.01, "of the largest command", "What is left of a command that is meant to be none, by offset or rounding."
    )
    saturated: float = setting(0.999, "of a limit", "A force or a command above is at it, but for rounding.")
    looked_at: int = setting(200, "states", "Usual speeds, ranges and forces are known to some per cent from as many.")
    apart_s: float = setting(0.02, "s", "Nearer states of a recording are the same motion.")
    asked: int = setting(
        4000, "samples", "How much force commands ask for peaks where they jump, which is seen in dense samples alone."
    )
    min_force: float = setting(
        1e-3,
        "N or N m",
        "A joint that nothing moved, such as a wheel that was never touched, has still some usual force.",
    )


@dataclass(frozen=True)
class EffortSettings:
    """How much of a recording is searched, and how much of it an explanation may leave, where that is special."""

    look_s: float = setting(
        6000.0,
        "simulated s",
        "A look at all effects of an arm with six joints simulates each second three hundred times; so much is a "
        "minute of one core, or less.",
    )
    impact_worth_another: float = setting(
        0.97, "of what fewer left", "What an impact does has many causes, each with a small share of it."
    )
    impact_unknown_share: float = setting(
        0.2,
        "of the gap",
        "Calibration: no simulator of rigid bodies follows real tosses closely (Acosta et al. 2022); about half of "
        "what a wrong friction makes is left, a fifth in squares.",
    )
    impact_searched_s: float = setting(8.0, "s", "A few seconds of flights and impacts tell as much as the tenfold.")


@dataclass(frozen=True)
class MechanismSettings:
    """All numbers of mechanisms, by what they are about."""

    replay: ReplaySettings = field(default_factory=ReplaySettings)
    flight: FlightSettings = field(default_factory=FlightSettings)
    start: StartSettings = field(default_factory=StartSettings)
    signal: SignalSettings = field(default_factory=SignalSettings)
    effort: EffortSettings = field(default_factory=EffortSettings)


MECHANISM = MechanismSettings()
