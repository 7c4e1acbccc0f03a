"""The generalised force that may be missing from a model: what it is called, and how large it might be."""

from __future__ import annotations

from dataclasses import dataclass

from runner.numerics.arrays import FloatArray


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
