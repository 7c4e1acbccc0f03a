"""What explanations make of episodes that they were not fitted to, and what no explanation can foretell."""

from __future__ import annotations

from dataclasses import dataclass

from runner.settings.declared import setting


@dataclass(frozen=True)
class HeldOutSettings:
    """Leaders against the episodes left out."""

    episodes: int = setting(
        2,
        "episodes",
        "By the convention of the format the last two check the explanation; where there are two or three, the last "
        "one.",
    )
    plain_excess: float = setting(
        1.0,
        "squared noises",
        "As much as the noise's own variance is plain to see in one episode, whatever the noise is taken for.",
    )
    most: float = setting(0.5, "share", "More than half of a sum is most of it.")
    max_astray_share: float = setting(
        0.2,
        "of all episodes",
        "Accidents are few: where nothing foretells more episodes, it is the explanations that are wrong.",
    )
    surprise_ratio: float = setting(
        3.0,
        "times that of fitted episodes",
        "Commands differ by less from episode to episode: so much more is something that was not there before.",
    )
    max_leaders: int = setting(
        6,
        "explanations",
        "Each costs a fit of all start states, and what is further behind is not turned to the first.",
    )
    close_log_odds: float = setting(
        20.0,
        "log odds",
        "What is left out may turn so small a distance, whatever the number of those that are as near.",
    )
    hopeless_log_odds: float = setting(200.0, "log odds", "An episode or two do not turn what all the others say.")
    stuck_loss: float = setting(
        4.0,
        "twice a log likelihood",
        "Another explanation leaves less of the episode by two standard errors, squared: a start state was not found.",
    )
    growing_shares: tuple[float, ...] = setting(
        (0.125, 0.18, 0.25, 0.35, 0.5, 0.7, 1.0),
        "of a stretch",
        "Each longer by the root of two: an error that grows with the square of time doubles, and the valley of the "
        "one before is still that of the next.",
    )
    rough_steps: int = setting(3, "steps", "Start states by which nothing is chosen need no more.")
    independent_errors_unseen: float = setting(
        3.0,
        "errors",
        "What the best explanation leaves is the doing of a few errors of the model, each of which bends many samples.",
    )


@dataclass(frozen=True)
class BreakawaySettings:
    """Motion that hangs on whether a push just overcomes static friction."""

    friction_changes: tuple[float, ...] = setting(
        (0.0025, 0.005, 0.01, 0.02),
        "of static friction, either way",
        "Static friction of any surface differs by that much from place to place, from a quarter of a per cent to two.",
    )
    max_lead_s: float = setting(
        0.4,
        "s",
        "A body that has started, or has not, is told from the other by the noise some tenths of a second later.",
    )
    outcome_s: float = setting(0.5, "s", "In that time a body that was started is far from one that was not.")
    lost_mean_square: float = setting(
        5.0,
        "mean square in noises",
        "No noise has as much over a tenth of a second, and no motion that is foretold leaves it.",
    )
    lost_for_s: float = setting(0.15, "s", "An outlier, or slow noise, is over by then.")
    first_s: float = setting(
        0.2, "s", "A velocity that is fitted to less of an episode is too uncertain to foretell the rest."
    )
    start_steps: int = setting(4, "steps", "A start that was fitted before has little to move.")
    max_growths: int = setting(8, "fits", "Each fit of the start reaches where it goes astray, mostly far at once.")
    min_samples: int = setting(10, "samples", "Fewer samples of an episode do not tell its start state.")
