"""How one explanation is fitted: where a descent begins, how it steps, when it ends."""

from __future__ import annotations

from dataclasses import dataclass

from runner.settings.declared import setting


@dataclass(frozen=True)
class FitSettings:
    """Descents, and the linear model that their steps and the screening of effects rest on."""

    max_steps: int = setting(
        15,
        "steps",
        "Levenberg-Marquardt rests earlier where a model is nearly linear, and where it is not, more steps gain "
        "little.",
    )
    nominal_steps: int = setting(
        30,
        "steps",
        "As long as the nominal model's start states are not at rest, any effect seems to help: it is given twice as "
        "many.",
    )
    screening_steps: int = setting(
        8,
        "steps",
        "A fit that is to show whether it is worth going on with takes off most of what it can in the first few steps.",
    )
    warm_steps: int = setting(12, "steps", "A fit that begins near where a similar one has ended has little way to go.")
    final_steps: int = setting(
        20, "steps", "Leaders are carried on until they rest, or no effect could be compared by what it leaves."
    )
    refit_steps: int = setting(
        25, "steps", "With one effect in the place of others, parameters and start states both have a long way to go."
    )
    patience_steps: int = setting(
        3,
        "steps",
        "Some steps have to show how fast a fit gains before it is judged by whether it will come near the others.",
    )
    outside_patience_steps: int = setting(
        4,
        "steps",
        "What has no name begins at nothing, with no linear model that says how much of it: it is judged one step "
        "later.",
    )
    tolerance_loss: float = setting(
        0.3, "twice a log likelihood", "A smaller gain moves log odds by 0.15: no comparison turns on that."
    )
    behind_excess: float = setting(
        0.05,
        "squared noises",
        "A fit that is behind the best by a twentieth of the noise's variance may still pass it, and is finished.",
    )
    behind_share: float = setting(
        0.5,
        "of what the best leaves",
        "A fit that leaves half as much again as the best may still pass it, as descents end at different speeds.",
    )
    behind_loss: float = setting(
        100.0,
        "twice a log likelihood",
        "Where hardly anything is left, shares of it say nothing: some ten standard errors, squared, are granted in "
        "any case.",
    )
    promise_factor: float = setting(
        3.0,
        "of the predicted gain",
        "Where a model is curved, later steps may gain a few times what the linear model promises of the next one.",
    )
    rest_share: float = setting(
        2e-3,
        "of what is left",
        "Where much is left, the form is wrong, and a step that takes off less than that settles nothing.",
    )
    difference_share: float = setting(
        0.02,
        "prior widths",
        "Steps of differences are small against what bends the motion and large against the rounding of contacts.",
    )
    min_gain_ratio: float = setting(
        0.6,
        "of the predicted gain",
        "Where a step gains more than that, the linear model holds: its derivatives are kept, its damping is eased.",
    )
    trust_radius: float = setting(
        4.0,
        "prior widths",
        "An amplitude of four standard deviations of its prior is hardly ever real: no linear model is asked beyond "
        "before a step that long has gained what it promised.",
    )
    information_ridge: float = setting(
        0.05,
        "per squared prior width",
        "What nothing measured depends on has no information and could move at no cost: a twentieth of what its prior "
        "says of it holds it, and takes nothing off what is measured.",
    )
    flat_prior: float = setting(
        1e4,
        "prior widths",
        "It stands for infinity where something is free: large against every amplitude, and far from where rounding "
        "shows.",
    )
    derivative_reuse: float = setting(
        0.1,
        "of value and prior width",
        "So near to where they were simulated, derivatives change by a similar share, which steps and screening bear: "
        "those that are off by no more of what a step did are kept.",
    )
    kept_surveys: int = setting(
        4,
        "surveys",
        "Asked for again are those around the nominal model and around the best, of what is fitted and of what is left"
        " out.",
    )
    divergence_halvings: int = setting(
        6, "halvings", "Where a motion diverges even at a 64th of an effect, nothing near that effect can be fitted."
    )
    min_start_samples: int = setting(
        5,
        "samples per channel",
        "A start state is a position and a velocity for each channel: fewer samples than that leave nothing of them to"
        " judge it by.",
    )
    scanned_sizes: int = setting(
        14,
        "values",
        "Valleys of what is left are narrower than the steps at which an effect is looked at first: between two of "
        "them, so many more are looked at.",
    )
    stale_share: float = setting(
        0.03,
        "of what a start's standard error does",
        "Derivatives by starts that are off by so much leave a thousandth of what is left, less than rest does.",
    )
    start_shares: tuple[float, ...] = setting(
        (1.0, 0.25, 0.0625, 0.0),
        "of its step",
        "Where not all episodes can go as far, each start takes one of these; a damped step would be as short for all.",
    )
    hit_difference_share: float = setting(
        1.0,
        "prior widths",
        "A hit falls into a step of the physics: smaller differences tell into which, and what that does to the "
        "rebound, and not where the body goes.",
    )
    drawn_starts: int = setting(
        40,
        "start states",
        "A body in the air has a handful of corners to hit with first: of so many each side has some.",
    )
    scanned_scales: tuple[float, ...] = setting(
        (0.5, 1.0, 2.0, 4.0, 8.0),
        "times the usual size of an effect",
        "Each is twice the one before: what follows a hit is in proportion over less than that.",
    )
    restart_factors: tuple[float, ...] = setting(
        (0.85, 1.1, 1.3),
        "times the fitted size",
        "An edge at which the motion jumps lies within some tenths of the size at which it has stopped a descent, and "
        "above it more often, as friction is fitted from small values.",
    )
    restart_min_share: float = setting(
        0.2,
        "of the nominal excess",
        "An effect that has explained less is not what is going on: no edge is in its way.",
    )
    max_restarts: int = setting(3, "restarts", "Each may cross one edge; with three of them a size may double.")
    restart_gain: float = setting(
        0.02, "of what is left", "Less than that is what a longer descent gains as well: no edge has been crossed."
    )
    restart_steps: int = setting(5, "steps", "So many show on which side of the edge less is left.")
