"""Channels: what is measured of an object, number by number, and the measured numbers with their noise.

Which ones there are, the `system` module of each kind says; of a mechanism, what `nominal.yaml` lists, among it any
sensor of the MJCF and the force of any actuator, such as a gripper's (`runner.recording.model_form_mapping`).
How noisy they are is estimated in `runner.noise.measured`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np

from runner.recording import Span

TRACKED = ("m", "rad", "m/s", "rad/s", "")  # units of what tracking tells; an orientation has none


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

    @property
    def instrument(self) -> str:
        """Where it comes from: channels of one instrument share the colour of their noise, those of motion one."""
        return "tracking" if self.unit in TRACKED else self.group


@dataclass(frozen=True)
class Scatter:
    """What no model predicts once an object has hit something: it counts as noise from there on.

    Args:
        level: Of each channel, (C,).
        calm: Per episode (T,): where nothing hits it, so that what a model shows from a start there it does predict.
    """

    level: np.ndarray
    calm: tuple[np.ndarray, ...]

    def parts(self, spans: Sequence[Span]) -> Scatter:
        """Return that of parts of the episodes, each with a start of its own."""
        return Scatter(self.level, tuple(self.calm[s.episode][s.begin : s.end] for s in spans))

    @property
    def hit(self) -> bool:
        """Whether anything is hit in any episode."""
        return not all(calm.all() for calm in self.calm)

    def begun(self, episode: int) -> np.ndarray:
        """Return where an episode is beyond its first hit, (T,)."""
        return np.logical_or.accumulate(~self.calm[episode])


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
