"""What a system is: everything that the diagnosis knows of an object, as one value that is bound to a recording.

The diagnosis fits, compares, localises and reports; what moves, what is measured of it and what may differ between
world and model it learns from here alone. A new kind of system is one package below `runner.systems` with

    channels        what is measured: columns of numbers whose differences make sense
    initial         what of an episode's start is unknown
    vocabulary      which effects may be at work, each bound to what it changes
    simulator       recorded commands and a start in, predicted channels out, with any set of effects
    disturbance     the generalised force that may be missing, for localising
    labels          what was going on in a stretch of time: at rest, sliding, reversing ...
    drawing         bodies and their poses, for figures and logs

and an entry in `runner.systems.case.open_case`, which tells from a folder which kind it is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from runner.effects.base import Effects
from runner.effects.vocabulary import Vocabulary
from runner.numerics.arrays import FloatArray
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.channels import Channel, Scatter, Signals
from runner.systems.disturbance import Disturbance
from runner.systems.drawing import DrawnBody
from runner.systems.initial import AbstractInitialState
from runner.systems.simulator import AbstractSimulator
from runner.systems.windows import Labels, Windows


class Proposal(Protocol):
    """An experiment that could be done next."""

    @property
    def sentence(self) -> str:
        """What to do, in a sentence or two."""
        ...


class AbstractSystem(ABC):
    """Everything that the diagnosis knows of an object; see the module's docstring.

    Attributes:
        recording: What was commanded and measured.
        channels: What is measured, C of them.
        initial: The unknown start.
        vocabulary: What may differ between world and model.
        beliefs: What effects are told when they put themselves into words.
        context: What candidates of the vocabulary are told when they describe themselves; opaque to the diagnosis.
        disturbance: The missing generalised force.
        rate_hz: Usual samples per second.
        regimes: What may be going on, in the order in which it is listed; the first is "at rest".
        factors: What windows are sorted by, the regime and the episode among it, each with a phrase for a sentence:
            {"speed": "at {}"}.
        activities: Those factors that say what was done, rather than where, when or how fast.
        noun: What the object is called in a sentence: "object", "mechanism".
        experiment: What is done to it: "push"; `reach`: what limits that so far; `reach_further`: what would go beyond.
        mismatch_levels: How far any simulator of such an object may be off in the direction of each effect, in units of
            `OddsSettings.mismatch_share`: equally likely multiples, 1 among them. How far is not known beforehand.
        unknown_share: Share of the gap that an explanation may leave and still be as likely as none of them.
        most_effects: So many may be at work at once.
        worth_another: Where the last of several effects leaves more than this share of what fewer left, it is not yet
            another one that is missing.
        searched_s: So many seconds of a recording are searched for an explanation, spread over all of it; where it is
            longer, the rest says where the gap lies and how it closes.
        cut_from: Squared noises that the best explanation leaves in pieces of a second from which on everything may be
            fitted in such pieces: where it leaves a smaller share in them than over longer times.
        episodes_differ: Whether single stretches may go elsewhere than any model says, so that each has a dispersion of
            its own: an impact that a hair's breadth turns.
        difference_share: How many prior widths of a parameter a difference takes that tells a derivative.
        commanded: Whether anything is commanded at all: nothing is of what is tossed.
        dates_disturbances: Whether what pushed once, beyond all that was commanded, is looked for.
        screening_level: At which of them effects are screened; the mismatch must not take what an effect could explain.
        plan_view: Positions in `channels` of two lengths that make a map, or None.
        force_views: Further columns of the table of missing forces that are worth a drawing, each with its label.
    """

    recording: Any  # a Recorded; each kind of system has its own
    channels: tuple[Channel, ...]
    initial: AbstractInitialState
    vocabulary: Vocabulary
    beliefs: Any
    context: Any
    disturbance: Disturbance
    rate_hz: float
    regimes: tuple[str, ...]
    factors: Mapping[str, str]
    activities: tuple[str, ...] = ("regime",)
    noun: str = "object"
    experiment: str = "experiment"
    reach: str = "the commands used so far"
    reach_further: str = "command faster, or over a wider range, or check it by hand"
    mismatch_levels: tuple[float, ...] = (1 / 16, 1 / 8, 1 / 4, 0.5, 1.0, 2.0, 4.0, 8.0)
    screening_level: float = 1 / 16
    unknown_share: float = 0.05
    most_effects: int = 6
    worth_another: float = 0.8
    searched_s: float = 30.0
    cut_from: float = 4.0
    episodes_differ: bool = False
    difference_share: float = SETTINGS.fit.difference_share
    commanded: bool = True
    dates_disturbances: bool = True
    plan_view: tuple[int, int] | None = None
    force_views: Mapping[str, str] = MappingProxyType({})

    @abstractmethod
    def values(self) -> tuple[FloatArray, ...]:
        """Return the measured channels of each episode, (T, C), NaN where not measured."""

    def readable(self) -> tuple[FloatArray, ...]:
        """Return the same as a reader expects them: an orientation, whose values are 0, as a rotation vector."""
        return self.values()

    @abstractmethod
    def stated_noise(self) -> FloatArray:
        """Return the standard deviation that the owner states for each channel, NaN where there is none, (C,)."""

    def owner_states_noise(self) -> NDArray[np.bool_]:
        """Return for which channels the owner states a noise, (C,); `stated_noise` may have a rough level beside."""
        return np.isfinite(self.stated_noise())

    def noise_by_owner(self) -> FloatArray:
        """Return the standard deviation that the owner states for each channel, NaN where none is stated, (C,)."""
        return np.where(self.owner_states_noise(), self.stated_noise(), np.nan)

    def misread(self) -> tuple[str, ...]:
        """Return what may have been read as something else than it is, in sentences; none by default."""
        return ()

    @abstractmethod
    def rests(self) -> list[tuple[int, slice]]:
        """Return where the object surely stands still, so that what is measured is noise: episode and samples."""

    def scatter(self) -> Scatter | None:
        """Return what no model of such an object predicts once it has hit something; None: nothing hits it.

        What an impact does depends on what nobody knows.
        """
        return None

    def stretches(self, near: Effects = ()) -> tuple[Span, ...]:
        """Return over which parts of the recording models can be replayed and compared: whole episodes as a rule.

        Where motion is so sensitive that small differences grow out of proportion, shorter ones. `near`: as models near
        this one show it; by default the one that is believed.
        """
        return tuple(Span(e, 0, len(v)) for e, v in enumerate(self.values()))

    @property
    def stretched_for_time(self) -> bool:
        """Whether `stretches` are shorter than episodes only so that what is searched holds some of every episode."""
        return False

    @abstractmethod
    def simulator(self, *, threads: int | None = None) -> AbstractSimulator:
        """Return the one simulator that everything uses: fits, gaps, figures; `threads` None: one per core."""

    def by_engine_alone(self) -> tuple[AbstractSimulator, float] | None:
        """Return a simulator that steps as the engine does by itself, and its step, s: that of the model's file.

        None where that tells nothing.
        """
        return None

    @property
    def has_noisy_drive(self) -> bool:
        """Whether what drove the object was measured, with the noise of a sensor, rather than known as a command is."""
        return False

    def driven_otherwise(self, draws: int) -> tuple[AbstractSystem, ...]:
        """Return the same recording with more noise on what drove the object, as large as its sensor's, so many times.

        None of them where the drive is known, see `has_noisy_drive`.
        """
        return ()

    def roughly(self) -> AbstractSystem:
        """Return it simulated in steps whose errors are small beside the noise of one reading, for a first search.

        By default itself, as where steps follow from what is recorded.
        """
        return self

    def settled(self, dispersion: float, near: Iterable[Effects] = ()) -> AbstractSystem | None:
        """Return it simulated in shorter steps, whose errors are small beside all readings together.

        None: they are short enough.

        Args:
            dispersion: How many times as uncertain as noise is what an explanation leaves, a variance: errors of the
                model that large hide more of those of a step.
            near: What may turn out to be meant: some effects ask for steps of their own.
        """
        return None

    def solved_otherwise(self) -> tuple[AbstractSystem, ...]:
        """Return the same beliefs with what a solver adds of its own solved in other ways; none by default."""
        return ()

    @property
    def solved(self) -> str:
        """How what may be `solved_otherwise` is solved, in words; empty where nothing is."""
        return ""

    def is_solved(self, effects: Effects) -> bool:
        """Whether these beliefs with effects in them hold anything that is solved as `solved` says."""
        return bool(self.solved)

    def as_told(self, effects: Effects, errors: Mapping[str, Mapping[str, float]]) -> Effects:
        """Return effects as a model is to hold them: numbers of a place that no motion tells are as they were believed.

        Args:
            effects: As they were fitted.
            errors: Standard errors of their numbers, by their names.
        """
        return effects

    def remedies_together(self, effects: Effects, errors: Mapping[str, Mapping[str, float]]) -> Mapping[str, str]:
        """Return what to change in a simulator for effects that change one element of it together, by their names.

        In the place of what each says by itself; empty: another one says it.
        """
        return {}

    def solver_remedy(self, effects: Effects) -> str:
        """Return what to change in a simulator so that it solves as what was found holds for; empty: nothing."""
        return ""

    @abstractmethod
    def label(self, signals: Signals, windows: Windows) -> Labels:
        """Return what went on in windows, from commands and measurements alone."""

    def phrase(self, factor: str, cell: str) -> str:
        """Return a cell of a factor as part of a sentence: "at 0.1 to 0.2 m/s"."""
        return self.factors[factor].format(cell)

    @abstractmethod
    def missing_force_views(self, values: FloatArray, spread: FloatArray, labels: Labels) -> dict[str, FloatArray]:
        """Return further columns of the table of missing forces, such as in body axes, each with its `_se`.

        Args:
            values: The missing force of each window, (W, D).
            spread: Its covariance, (W, D, D).
            labels: Of the windows.
        """

    def force_shapes(self, missing: pd.DataFrame) -> Mapping[str, Mapping[str, FloatArray]]:
        """Return what each missing force may go along with: columns (W, k) by what they are in words; none by default.

        Args:
            missing: A row for each window, see `runner.localise.where.Where`.
        """
        return {}

    @abstractmethod
    def proposals(self) -> tuple[Sequence[Proposal], AbstractSystem, FloatArray]:
        """Return experiments that could be done next.

        Returns:
            The experiments, a system whose episode i is experiment i with nothing measured, and the start of them
            all, (S,).
        """

    def model_use(self, effects: Effects) -> str:
        """Return how the `model.xml` that `write_model` writes is used."""
        return "runs in plain MuJoCo; what MJCF can't express its first lines name"

    @abstractmethod
    def write_model(self, effects: Effects, folder: Path) -> tuple[str, ...]:
        """Write the model with these effects in it, as its owner can use it; return the names of the files.

        Raises:
            ResultError: If what was written can't be used, or behaves otherwise than was simulated and doesn't say so.
        """

    @abstractmethod
    def drawn(self) -> tuple[DrawnBody, ...]:
        """Return the bodies to draw."""

    @abstractmethod
    def poses(self, episode: int, channels: FloatArray) -> dict[str, FloatArray]:
        """Return the pose of each drawn body at the samples of an episode: x, y, z, qw, qx, qy, qz, (T, 7) each.

        Args:
            episode: Its position in the recording.
            channels: Measured or predicted, (T, C), without NaN.
        """

    def believed(self) -> tuple[tuple[str, str], ...]:
        """Return what the owner believes of the object, for a reader: ("mass", "3 kg")."""
        return ()

    def command_arrows(self, episode: int, channels: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return commanded forces to draw: where each acts and how large it is, world axes, (T, 3) m and N; or None.

        Args:
            episode: Its position in the recording.
            channels: Measured or predicted, (T, C), without NaN.
        """
        return None
