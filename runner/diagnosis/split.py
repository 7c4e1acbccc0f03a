"""Which episodes of a recording are fitted, and which check what was found."""

from __future__ import annotations

from collections.abc import Sequence

from runner.errors import RecordingError
from runner.settings import SETTINGS


def split(numbers: Sequence[int]) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the positions of the episodes that are fitted, and of those held out: the last by their numbers.

    Raises:
        RecordingError: If there are fewer than two.
    """
    count = len(numbers)
    if count < 2:
        raise RecordingError(
            f"a diagnosis needs at least 2 episodes, one of them to check the explanation, got {count}."
        )
    usual = SETTINGS.held_out.episodes
    held = usual if count > usual + 1 else 1
    order = sorted(range(count), key=lambda i: numbers[i])
    return tuple(order[: count - held]), tuple(order[count - held :])
