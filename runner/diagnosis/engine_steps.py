"""What the engine's own steps make of a model, beside its equations of motion.

A diagnosis integrates to second order in the step. An engine that is first order is off by what a clock that is half
a step ahead, or damping times half a step as inertia, would do. A log that it wrote in such steps shows just that, and
a fine sensor tells it; one that it wrote in finer steps, or that was measured, does not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from runner.effects.base import Effects
from runner.noise.measured import Measured
from runner.recording import Span
from runner.systems.base import AbstractSystem
from runner.systems.simulator import Run


def said_of_engine_steps(
    system: AbstractSystem,
    measured: Measured,
    effects: Effects,
    starts: Mapping[int, np.ndarray],
    spans: Sequence[Span],
) -> tuple[str, ...]:
    """Say by how much the engine's own steps are off, if by more than the model is in a channel.

    Args:
        system: What was diagnosed.
        measured: Its noise.
        effects: What was found.
        starts: The start state of each stretch with that in the model, by its position.
        spans: The stretches.
    """
    alone = system.by_engine_alone()
    # where something is hit two steps of different lengths soon part, and how hard a contact is hangs on the step
    if alone is None or not starts or measured.hits(range(len(measured.values))):
        return ()
    engine, step_s = alone
    one, other = system.simulator().parts(spans), engine.parts(spans)
    asked = [(e, [Run(effects, s)]) for e, s in starts.items()]
    shown, stepped = (np.concatenate(by.predict_each(asked), axis=1)[0] for by in (one, other))
    noises, parts = _rms(stepped - shown) / measured.sigma, measured.parts(spans)
    seen = np.concatenate([np.where(parts.valid[e], parts.values[e], np.nan) for e in starts])
    # steps that are off by less than the model is, whichever way it is stepped, are no matter
    bearable = np.maximum(np.minimum(*(_rms(by - seen) / measured.sigma for by in (shown, stepped))), 1.0)
    worst = int(np.argmax(noises / bearable))
    if not noises[worst] > bearable[worst]:
        return ()
    # of first order: half the step leaves half, and what leaves half of what the model misses adds an eighth to it
    enough_s = step_s / 2.0 ** np.ceil(np.log2(2.0 * noises[worst] / bearable[worst]))
    return (
        f"The model's `timestep` of {step_s:g} s is too long to replay it in MuJoCo alone, which is then "
        f"{noises[worst]:.2g} noises of '{system.channels[worst].name}' off (runner takes finer steps of its own): set "
        f"it to {enough_s:.3g} there. If MuJoCo made this recording in such long steps, they are part of what was "
        "measured, and may have been taken for a delay or for inertia.",
    )


def _rms(of: np.ndarray) -> np.ndarray:
    """Return the root mean square of each channel of what there is, (T, C) to (C,)."""
    return np.sqrt(np.nanmean(of**2, axis=0))
