"""What a reader of a diagnosis should know before believing its figures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence, Set

import numpy as np

from runner.effects.base import Scope
from runner.effects.vocabulary import spoken
from runner.effects.wording import listed, number
from runner.importing.record import called, has_turned_axes
from runner.inference.contender import Contender
from runner.inference.least_squares import Fit, amplitudes
from runner.noise.measured import Measured, off_from_stated
from runner.recording import Span
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.recorded import Recorded

MOST_PLACES = 3  # values that are told one by one; of more, episodes that are


def notes(
    system: AbstractSystem,
    measured: Measured,
    held_out: Sequence[int],
    *,
    stretched: Sequence[str] = (),
    turned: bool = False,
    astray: Sequence[Span] = (),
    outside: Sequence[str] = (),
) -> tuple[str, ...]:
    """Say what a reader should know before believing the figures.

    Args:
        system: What was diagnosed.
        measured: Its channels and their noise, whole episodes.
        held_out: The episodes that explanations were checked on.
        stretched: Over how long models were replayed, where that is not whole episodes.
        turned: Whether the first episodes were held out instead of the last.
        astray: Stretches that were not fitted and of which no explanation foretells what most others show.
        outside: What was said of effects that have no name, and of what happened once.
    """
    recording: Recorded = system.recording
    out = [*recording.notes, *outside]
    if has_turned_axes(recording.path):
        out.append(
            "Axes are those of the case, in which z points up: x, y and z here, of bodies too, are x, -z and y of the "
            "log."
        )
    if known := dict.fromkeys(spoken(c.name) for c in system.vocabulary.ruled_out):
        out.append(f"Not tried, as nominal.yaml says that it is known: {listed(list(known))}.")
    if not np.isfinite(measured.stated).all():
        out.append("The noise was not stated for every channel and was estimated from the recording.")
    if off := off_from_stated(measured, system):
        each = ", ".join(f"{times:.2g} times in {channels}" for channels, times in off.items())
        out.append(f"The noise is not what is stated, by what the recording shows, but {each}.")
    hit = measured.scatter is not None and measured.scatter.hit
    if hit and (hidden := measured.is_scatter()).any():
        channels = ", ".join(c.name for c, hides in zip(system.channels, hidden, strict=True) if hides)
        out.append(
            f"After an impact equally good models differ by more than the noise of the sensors in {channels}: that "
            "counts as noise."
        )
    for e, sample in measured.hung.items():
        episode = recording.episodes[e]
        out.append(
            f"What episode {called(recording.path, episode.index)} shows from {episode.t_s[sample]:.2f} s on counts "
            "for the closure alone: whether a push there starts the body hangs on less friction than surfaces are "
            "even in."
        )
    if measured.noise_model.lag_one.any():
        out.append("The noise is correlated from sample to sample; this was taken into account.")
    if dropped := _left_out(measured, system):
        out.append(dropped)
    if turned:
        out.append(
            "What the last episodes show the others do not, or hardly: they were fitted, and the first ones held out."
        )
    if astray:
        out.append(
            f"{listed(_times_of(recording, astray))} no explanation brings the simulator much nearer, though one does "
            "on the rest of what was not fitted: that is in no figure here. The motion hangs on a hair there, or "
            "something else happened: look at it by `runner view`, or leave it out."
        )
    if len(held_out) < SETTINGS.held_out.episodes:
        out.append("Only one episode was left to check the explanation: with more of them the check says more.")
    return (*out, *stretched)


def _times_of(recording: Recorded, spans: Sequence[Span]) -> list[str]:
    """Return when each stretch was, those of one episode together; the first begins a sentence."""
    of: dict[str, list[str]] = {}
    for span in spans:
        episode = recording.episodes[span.episode]
        times = f"from {episode.t_s[span.begin]:.2f} to {episode.t_s[span.end - 1]:.2f} s"
        of.setdefault(called(recording.path, episode.index), []).append(times)
    told = [f"{listed(times)} of episode {name}" for name, times in of.items()]
    return [f"F{told[0][1:]}", *told[1:]]


def doubts(
    system: AbstractSystem,
    measured: Measured,
    top: Contender,
    unsure: Sequence[str] = (),
    needed: Set[str] = frozenset(),
) -> tuple[str, ...]:
    """Say why the numbers of the explanation that is put into the corrected model may not be what they look like.

    `unsure` are those of its effects that do not stand out of their own errors, `needed` those without which a plain
    gap is left.
    """
    out = [f"{said}." for said in system.misread()]
    for name in unsure:
        if name not in needed:
            out.append(f"The numbers of {spoken(name)} hardly stand out of their own errors: it may not be there.")
            continue
        out.append(
            f"Something like {spoken(name)} is needed, as a plain gap is left without it; but its numbers do not stand "
            "out of their own errors, so that another cause of nearly the same motion may be meant. Confirm it by hand "
            "before the model is changed by that."
        )
    if far := _far_from_usual(top.fit, system.context):
        out.append(
            f"By how much {listed(far)} {'differs' if len(far) == 1 else 'differ'} from the model is more than "
            f"{SETTINGS.fit.trust_radius:.0f} times what is usual. It may be so; but what stands in for a cause that "
            "was not tried has such numbers, too, and so has what was read in a wrong unit: see by hand whether it can "
            "be, before the model is changed."
        )
    if not top.fit.converged:
        out.append(
            "The fit of the best explanation was still moving when its steps were used up, so that its errors may be "
            "too small. Before relying on its numbers diagnose this recording and another as one case (`runner import` "
            "takes several logs)."
        )
    if measured.scatter is not None and measured.scatter.hit and top.fit.explanation.candidates:
        out.append(
            "Of what hits something standard errors hold only roughly what contact models lack: in a test on tosses "
            "that another engine simulated, a quarter of the numbers were off the truth by two to four of them."
        )
    return tuple(out)


def _far_from_usual(fit: Fit, context: Scope) -> list[str]:
    """Return the effects of which there is more than a linear model is asked about, as they are read."""
    parameters = fit.explanation.parameters(context)
    far = np.abs(fit.x) > SETTINGS.fit.trust_radius * np.array([p.scale for p in parameters])
    out = []
    for c, part in fit.explanation.parts(context):
        which = [i for i in np.arange(len(fit.x))[amplitudes(c, part, context)] if far[i]]
        usual = {f"{number(parameters[i].scale, 2)} {parameters[i].unit}" for i in which if parameters[i].unit}
        if which:
            out.append(spoken(c.name) + (f" (usual: {listed(sorted(usual))})" if usual else ""))
    return out


def _left_out(measured: Measured, system: AbstractSystem) -> str:
    """Say how many values stick out of their neighbours, and which where they are few; empty: none does."""
    out = [np.argwhere(np.isfinite(x) & ~v) for x, v in zip(measured.values, measured.valid, strict=True)]
    places = [(e, int(sample), int(c)) for e, found in enumerate(out) for sample, c in found]
    if not places:
        return ""
    said = (
        "1 value sticks out of its neighbours and was"
        if len(places) == 1
        else (f"{len(places)} values stick out of their neighbours and were")
    )
    episodes = system.recording.episodes
    if len(places) > MOST_PLACES:
        channels, of = (Counter(each).most_common() for each in ([c for *_, c in places], [e for e, *_ in places]))
        by_channel = listed([f"{count} of {system.channels[c].label}" for c, count in channels])
        named = [f"{called(system.recording.path, episodes[e].index)} ({count})" for e, count in of[:MOST_PLACES]]
        more = [f"{len(of) - MOST_PLACES} more"] if len(of) > MOST_PLACES else []
        return f"{said} left out: {by_channel}; in {'episode' if len(of) == 1 else 'episodes'} {listed(named + more)}."
    each = listed(
        [
            f"{system.channels[c].label} at {episodes[e].t_s[i]:.2f} s of episode "
            f"{called(system.recording.path, episodes[e].index)}"
            for e, i, c in places
        ]
    )
    return f"{said} left out: {each}."
