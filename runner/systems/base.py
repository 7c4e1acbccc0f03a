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

and an entry in `runner.systems.open_case`, which tells from a folder which kind it is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from runner.effects.base import Effects
from runner.effects.vocabulary import Candidate, Vocabulary
from runner.recording import Span

FloatArray = NDArray[np.float64]


class Space(Enum):
    """Which numbers a channel has: a line, a circle (angles, unwrapped), or one axis of a turn's log map."""

    LINE = "line"
    CIRCLE = "circle"
    ROTATION = "rotation"


@dataclass(frozen=True)
class Channel:
    """One measured number.

    Args:
        name: Its column in the recording; of an orientation, `NAME.x`, `.y`, `.z`: its turn from what was measured.
        unit: SI, "" for a pure number.
        group: Channels of one group share a noise level: they come from one kind of sensor.
        label: In words, for a reader: "heading".
        space: Which numbers it has. Predictions come in coordinates in which `prediction - measurement` is the
            residual: angles unwrapped alongside the measurement, orientations as the log map from it.
    """

    name: str
    unit: str
    group: str
    label: str
    space: Space = Space.LINE


@dataclass(frozen=True)
class Run:
    """One open-loop simulation: the effects that are in the model, and the start that it begins from, (S,)."""

    effects: Effects
    start: FloatArray


class RecordedEpisode(Protocol):
    """What every kind of recording has of an episode."""

    @property
    def index(self) -> int:
        """Its number in the recording."""
        ...

    @property
    def t_s(self) -> FloatArray:
        """Time of each sample, (T,)."""
        ...

    @property
    def step_s(self) -> float:
        """Usual time from one sample to the next."""
        ...

    def __len__(self) -> int: ...


class Recorded(Protocol):
    """What every kind of recording has."""

    @property
    def path(self) -> Path:
        """Where it was read from."""
        ...

    @property
    def episodes(self) -> Sequence[RecordedEpisode]:
        """In the order of the file."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What was odd about the files, yet no error."""
        ...


@dataclass(frozen=True)
class Windows:
    """Windows of one length, in samples: `episode` and `first` sample of each, both (W,), and `samples` of each."""

    episode: np.ndarray
    first: np.ndarray
    samples: int

    def __len__(self) -> int:
        return len(self.episode)

    def of(self, arrays: Sequence[np.ndarray]) -> np.ndarray:
        """Return what arrays (T, ...), one per episode, hold in each window: (W, samples, ...)."""
        steps = np.arange(self.samples)
        return np.stack([arrays[e][f + steps] for e, f in zip(self.episode, self.first, strict=True)])

    def chunks(self, size: int) -> list[tuple[slice, Windows]]:
        """Return them in portions of at most `size`."""
        parts = [slice(begin, begin + size) for begin in range(0, len(self), size)]
        return [(part, Windows(self.episode[part], self.first[part], self.samples)) for part in parts]


class Signals(Protocol):
    """Measured channels and their noise levels; `runner.noise.measured.Measured` is one."""

    @property
    def values(self) -> tuple[np.ndarray, ...]:
        """Per episode (T, C)."""
        ...

    @property
    def valid(self) -> tuple[np.ndarray, ...]:
        """Per episode (T, C): False for what does not count."""
        ...

    @property
    def sigma(self) -> np.ndarray:
        """Noise of each channel, (C,)."""
        ...

    @property
    def spans(self) -> tuple[Span, ...]:
        """Where in the recording each episode lies: parts of episodes are taken for episodes of their own."""
        ...


class AbstractInitialState(ABC):
    """What of the start of an episode, or of a window of it, is unknown: S numbers.

    Attributes:
        steps: For differences, (S,): small against a motion, large against rounding.
    """

    steps: FloatArray

    @property
    def size(self) -> int:
        """How many numbers."""
        return len(self.steps)

    @abstractmethod
    def scale(self, sigma: FloatArray) -> FloatArray:
        """Return how far a start may be from its guess, (S,), from the noise of each channel, (C,)."""

    @abstractmethod
    def guess(self, signals: Signals, episode: int) -> FloatArray:
        """Return a rough start of an episode from its first samples, (S,)."""

    @abstractmethod
    def guess_windows(self, signals: Signals, windows: Windows, *, smooth: bool) -> FloatArray:
        """Return a start of each window, (W, S): from its first sample, or `smooth` from the samples around that."""


@dataclass(frozen=True)
class Disturbance:
    """The generalised force that may be missing from the model, D numbers: what it is called, and how large.

    Args:
        names: Columns of the table of missing forces, with units in them: "fx_n".
        labels: In words, with the unit: "towards world x [N]".
        steps: For differences, (D,).
        prior: How large each might be, (D,).
    """

    names: tuple[str, ...]
    labels: tuple[str, ...]
    steps: FloatArray
    prior: FloatArray


class AbstractSimulator(ABC):
    """Simulates a recording's commands open loop, many sets of effects and starts at once.

    Attributes:
        simulated_s: How much has been simulated so far, in seconds of the object's time.
    """

    simulated_s: float

    @abstractmethod
    def predict(self, episode: int, runs: Sequence[Run]) -> FloatArray:
        """Return the predicted channels at the samples of an episode, or span, (len(runs), T, C)."""

    @abstractmethod
    def parts(self, spans: Sequence[Span]) -> AbstractSimulator:
        """Return a simulator of parts of what this one simulates; `episode` counts what that is."""

    @abstractmethod
    def predict_windows(
        self, effects: Effects, windows: Windows, starts: FloatArray, disturbance: FloatArray | None = None
    ) -> FloatArray:
        """Return the predicted channels in windows, each begun anew.

        Args:
            effects: What is in the model.
            windows: W of them.
            starts: As `AbstractInitialState.guess_windows` has them, K for each: (W, K, S): states that are *shown* by
                the sensors with these effects, the model starts from the true ones behind them.
            disturbance: A constant generalised force in each, (K, D) or (W, K, D).

        Returns:
            (W, K, samples, C), the first of the samples the start.
        """

    @abstractmethod
    def seen_start(self, effects: Effects, start: FloatArray) -> FloatArray:
        """Return the true start (S,) that sensors with these effects show as the given one."""


@dataclass(frozen=True)
class Labels:
    """What went on in each window, and where.

    Args:
        table: One row per window: `episode` ("episode 3"), `t_s` of its middle, a column of text or None for each
            factor of `AbstractSystem.factors`, and any numbers that describe it.
        places: Of the factor `place`, if there is one: the middle of each cell by its label.
    """

    table: pd.DataFrame
    places: Mapping[str, tuple[float, float]] = field(default_factory=dict)


@dataclass(frozen=True)
class Shape:
    """A shape of a drawn body: `kind` box | sphere | cylinder | capsule, `size_m` as MuJoCo has it, where on the body.

    `position_m` (3,), `quaternion_wxyz` (4,), both in the body's frame.
    """

    kind: str
    size_m: tuple[float, ...]
    position_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    quaternion_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class DrawnBody:
    """A body as figures and logs draw it."""

    name: str
    shapes: tuple[Shape, ...]


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
            `runner.inference.evidence.SHARE`: equally likely multiples, 1 among them. How far is not known beforehand.
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
    reach_further: str = "command more, or otherwise"
    mismatch_levels: tuple[float, ...] = (1 / 16, 1 / 8, 1 / 4, 0.5, 1.0, 2.0, 4.0, 8.0)
    screening_level: float = 1 / 16
    plan_view: tuple[int, int] | None = None
    force_views: Mapping[str, str] = MappingProxyType({})

    @abstractmethod
    def values(self) -> tuple[FloatArray, ...]:
        """Return the measured channels of each episode, (T, C), NaN where not measured."""

    @abstractmethod
    def stated_noise(self) -> FloatArray:
        """Return the standard deviation that the owner states for each channel, NaN where there is none, (C,)."""

    @abstractmethod
    def rests(self) -> list[tuple[int, slice]]:
        """Return where the object surely stands still, so that what is measured is noise: episode and samples."""

    @abstractmethod
    def simulator(self, *, threads: int | None = None) -> AbstractSimulator:
        """Return the one simulator that everything uses: fits, gaps, figures; `threads` None: one per core."""

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

    @abstractmethod
    def proposals(self) -> tuple[Sequence[Proposal], AbstractSystem, FloatArray]:
        """Return experiments that could be done next.

        Returns:
            The experiments, a system whose episode i is experiment i with nothing measured, and the start of them
            all, (S,).
        """

    @abstractmethod
    def write_model(self, effects: Effects, folder: Path) -> tuple[str, ...]:
        """Write the model with these effects in it, as its owner can use it; return the names of the files.

        Raises:
            ResultError: If what was written behaves otherwise than what was simulated.
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


__all__ = [
    "AbstractInitialState",
    "AbstractSimulator",
    "AbstractSystem",
    "Candidate",
    "Channel",
    "Disturbance",
    "DrawnBody",
    "Effects",
    "FloatArray",
    "Labels",
    "Proposal",
    "Recorded",
    "Run",
    "Shape",
    "Signals",
    "Space",
    "Span",
    "Vocabulary",
    "Windows",
]
