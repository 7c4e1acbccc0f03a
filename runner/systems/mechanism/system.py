"""Any mechanism: an MJCF that somebody believes in, and a log of what it was commanded and what it did."""

from __future__ import annotations

import copy
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from runner.effects.base import Effects
from runner.effects.mechanism.inertials import as_told, inertials
from runner.effects.mechanism.parts import attribute
from runner.effects.wording import listed
from runner.numerics.arrays import FloatArray
from runner.recording import Span
from runner.recording.model_form import MechanismRecording, nominal_file, read_model_case, with_episode_to_check
from runner.recording.model_form_mapping import ChannelSource
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem
from runner.systems.channels import Channel, Scatter, Signals, Space
from runner.systems.disturbance import Disturbance
from runner.systems.drawing import DrawnBody
from runner.systems.mechanism.coordinates import FREE, HINGE, SLIDE
from runner.systems.mechanism.drawing import body_poses, drawn_bodies
from runner.systems.mechanism.flights import flights, measured_freely, rests, size_m
from runner.systems.mechanism.initial import MechanismStart
from runner.systems.mechanism.labels import FACTORS, PHRASES, REGIMES, label
from runner.systems.mechanism.misread import exchanged, falling_otherwise, in_another_order, in_other_units
from runner.systems.mechanism.model_file import LAW, left_out, needing_law, write_model
from runner.systems.mechanism.models import HARD_IMPEDANCE, HARD_S, Models, has_soft_friction
from runner.systems.mechanism.proposals import Trial, trials, unmeasured
from runner.systems.mechanism.rests import resting
from runner.systems.mechanism.scatter import scatter
from runner.systems.mechanism.scope import (
    raw_signals,
    scope_of,
    vocabulary_of,
    with_rotation_vectors,
)
from runner.systems.mechanism.settings import MECHANISM
from runner.systems.mechanism.shapes import force_shapes
from runner.systems.mechanism.simulator import MechanismSimulator, cores
from runner.systems.mechanism.steps import choose_step, settled_step
from runner.systems.mechanism.stretches import impact_stretches, replayed, survey_step_s
from runner.systems.raw_signals import RawSignals
from runner.systems.stretches import Cut, Sensitive
from runner.systems.windows import Labels, Windows

HARD = "joints that dry friction truly holds (solreffriction as hard as the step allows)"
SOFT = "dry friction as soft as the MJCF has it (solreffriction)"


class MechanismSystem(AbstractSystem):
    """A recording in model form, see `AbstractSystem`.

    Args:
        recording: The case.
        step_s: Physics step; None: as long as it does no harm.
        hard_friction: Whether joints' dry friction holds, whatever the MJCF's `solreffriction`; None: as believed where
            any is, and hard where there is none, as then nobody believes in a soft one.
        dispersion: How many times as uncertain as noise residuals are, a variance: physics steps are so long that their
            error is small beside that. Infinite: beside the noise of one reading.
    """

    regimes = REGIMES
    factors = FACTORS
    activities = ("regime", "load")
    noun = "mechanism"
    plan_view = None
    # of two effects that do the same each would be explained away by what the other's small mismatch may do
    screening_level = 0.0
    recording: MechanismRecording
    initial: MechanismStart  # ty: ignore[incompatible-mutable-override]  # none of another kind is ever put there

    def __init__(
        self,
        recording: MechanismRecording,
        *,
        step_s: float | None = None,
        hard_friction: bool | None = None,
        dispersion: float = 1.0,
    ) -> None:
        self.recording, self._dispersion = recording, dispersion
        self.channels = tuple(_channel(s) for s in recording.mapping.sources)
        self.rate_hz = 1.0 / recording.step_s
        self.commanded = bool(recording.mapping.commands or recording.mapping.forces)
        if not self.commanded:
            self.experiment, self.reach = "episode", "what was recorded so far"
            self.reach_further = "let it move faster, farther or from other starts, or check it by hand"
        if hard_friction is None:
            hard_friction = not any(joint.frictionloss > 0 for joint in recording.spec().joints)
        self._models = Models(recording, cores(), hard_friction=hard_friction)
        self._raw = raw_signals(recording)
        self.initial = MechanismStart(recording, self._models, self._raw.sigma)
        self.context = self.beliefs = scope_of(recording, self._models, self.initial, self._raw)
        every = vocabulary_of(recording, self.context, self.initial.coordinates)
        self.vocabulary = every.without(recording.mapping.known, nominal_file(recording.path))
        ways = sum(len(c.starts(self.context)) or len(c.parameters(self.context)) for c in self.vocabulary)
        self.searched_s = min(self.searched_s, MECHANISM.effort.look_s / max(ways, 1))
        self.disturbance = self._missing_force()
        self._step_s = step_s
        self._simulator: MechanismSimulator | None = None
        self._cut: Cut | None = None  # found on the way to the step
        self._stretches: tuple[Span, ...] | None = None
        self._found_flights = self._flights()
        if len(joints := self.context.model.jnt_type) and (joints == FREE).all():
            self.noun = "body"
        if any(self._found_flights):
            of, self.episodes_differ = MECHANISM.effort, True
            self.worth_another, self.unknown_share = of.impact_worth_another, of.impact_unknown_share
            self.searched_s = of.impact_searched_s
            self.difference_share = SETTINGS.fit.hit_difference_share
            # what is smaller than that tells which corner chatters, and not where the body goes
            step, size = MECHANISM.start.difference_of_size, size_m(self.context.model)
            coarse = np.array([step * (size if c.unit == "m" else 1.0) for c in self.channels])
            self.initial.steps = self.initial.scale(np.maximum(self._raw.sigma, coarse))

    @property
    def step_s(self) -> float:
        """Length of a physics step."""
        if self._step_s is None:
            starts = [self.initial.guess(self._raw, e) for e in range(len(self.recording.episodes))]
            self._step_s = choose_step(self.recording, self._models, starts, self._raw.sigma, cores())
            # what is hit in two steps of different lengths soon goes two ways
            if not any(self._found_flights):
                known = self._sensitive(MechanismSimulator(self.recording, self._models, self._step_s))
                self._cut = self._cut or replayed(known, self.searched_s)
                if math.isfinite(self._dispersion):
                    self._step_s = settled_step(known, self._cut.spans, self.searched_s, self._dispersion)
        return self._step_s

    def roughly(self) -> MechanismSystem:
        """See `AbstractSystem`."""
        return self if any(self._found_flights) else self._for(math.inf)

    def settled(self, dispersion: float, near: Iterable[Effects] = ()) -> MechanismSystem | None:
        """See `AbstractSystem`."""
        if not dispersion < self._dispersion or any(self._found_flights):
            return None
        other = self._for(dispersion)
        other.stretches()  # by them is told how long the steps of a survey may be
        before, after = self.simulator(), other.simulator()
        shorter = ((after.step_with(e), before.step_with(e)) for e in ((), *near))
        return other if any(a < b and not math.isclose(a, b) for a, b in shorter) else None

    def _for(self, dispersion: float) -> MechanismSystem:
        """Return it simulated for residuals so many times as uncertain as noise."""
        other = copy.copy(self)  # what is believed, seen and compiled stays the same
        other._dispersion, other._step_s, other._simulator, other._stretches = dispersion, None, None, None
        if self._simulator is not None:
            other.simulator(threads=self._simulator.threads)
        return other

    def _sensitive(self, simulator: MechanismSimulator, near: Effects = ()) -> Sensitive[MechanismSimulator]:
        """Return the recording as what responds to a small force, by a simulator."""
        usual = self.disturbance.prior / SETTINGS.where.max_force
        return Sensitive(self.recording, simulator, self.initial, usual, self._raw, near)

    def _missing_force(self) -> Disturbance:
        """Return the force that may be missing at each joint."""
        coordinates = self.initial.coordinates
        weight = float(np.sum(self.context.model.body_mass)) * float(np.linalg.norm(self.context.model.opt.gravity))
        usual = np.full(coordinates.nv, max(weight, MECHANISM.signal.min_force))
        for joint in coordinates.joints:
            if joint.kind in (HINGE, SLIDE):
                usual[joint.v] = max(self.context.force[joint.name], MECHANISM.signal.min_force)
            else:
                # turns: the weight on an arm as long as the model
                usual[joint.v.stop - 3 : joint.v.stop] *= 0.1 * float(self.context.model.stat.extent)
        names = coordinates.dof_names()
        return Disturbance(
            tuple(f"{name}_{unit.replace(' ', '_').lower()}" for name, unit, _ in names),
            tuple(f"{words} [{unit}]" for _, unit, words in names),
            SETTINGS.where.force_step * usual,
            SETTINGS.where.max_force * usual,
        )

    def values(self) -> tuple[FloatArray, ...]:
        """See `AbstractSystem`."""
        return tuple(e.values for e in self.recording.episodes)

    def readable(self) -> tuple[FloatArray, ...]:
        """See `AbstractSystem`; rotation vectors are of the body against the world, rad."""
        return tuple(with_rotation_vectors(self.recording, e) for e in self.recording.episodes)

    def stated_noise(self) -> FloatArray:
        """Return what the owner states; of an orientation otherwise a rough level, as its channels show none."""
        rough = [
            s if c.space is Space.ROTATION else np.nan for c, s in zip(self.channels, self._raw.sigma, strict=True)
        ]
        return np.array(
            [self.recording.mapping.noise.get(c.name, r) for c, r in zip(self.channels, rough, strict=True)]
        )

    def owner_states_noise(self) -> NDArray[np.bool_]:
        """See `AbstractSystem`."""
        return np.array([c.name in self.recording.mapping.noise for c in self.channels])

    def solved_otherwise(self) -> tuple[MechanismSystem, ...]:
        """Return it with dry friction that holds, if it was soft; as the MJCF has it, if it held."""
        if not has_soft_friction(self._models.compiled(()).model):
            return ()
        hard = not self._models.hard_friction
        other = MechanismSystem(self.recording, hard_friction=hard, dispersion=self._dispersion)
        other.simulator(threads=self.simulator().threads)
        return (other,)

    @property
    def solved(self) -> str:
        """See `AbstractSystem`."""
        return HARD if self._models.hard_friction else SOFT

    def is_solved(self, effects: Effects) -> bool:
        """See `AbstractSystem`."""
        return bool((self._models.edited(effects).dof_frictionloss > 0).any())

    def as_told(self, effects: Effects, errors: Mapping[str, Mapping[str, float]]) -> Effects:
        """See `AbstractSystem`."""
        return as_told(self.beliefs.model, effects, errors)

    def remedies_together(self, effects: Effects, errors: Mapping[str, Mapping[str, float]]) -> Mapping[str, str]:
        """See `AbstractSystem`."""
        return inertials(self.beliefs.model, effects, errors)

    def solver_remedy(self, effects: Effects) -> str:
        """See `AbstractSystem`."""
        joints = self._models.hardened(effects)
        if not joints:
            return ""
        model = self.beliefs.model
        dofs = [int(model.joint(name).dofadr[0]) for name in joints]
        reference = _to_set((max(HARD_S, 2.0 * self._models.file_step_s), 1.0), model.dof_solref[dofs])
        impedance = _to_set(HARD_IMPEDANCE, model.dof_solimp[dofs])
        named = listed([f'<joint name="{name}">' for name in joints])
        return (
            f'Let dry friction hold, as here: in {named} set solreffriction="{reference}" solimpfriction="{impedance}".'
        )

    def misread(self) -> tuple[str, ...]:
        """See `AbstractSystem`."""
        of = self.recording, self._models
        falling, turned = falling_otherwise(*of), in_another_order(*of, self.initial.coordinates)
        return (*in_other_units(*of), *exchanged(*of), *falling, *turned)

    def rests(self) -> list[tuple[int, slice]]:
        """See `AbstractSystem`."""
        return resting(self.recording)

    def simulator(self, *, threads: int | None = None) -> MechanismSimulator:
        """See `AbstractSystem`."""
        if self._simulator is None or (threads is not None and threads != self._simulator.threads):
            rough = math.isinf(self._dispersion)
            self._simulator = MechanismSimulator(self.recording, self._models, self.step_s, threads, rough=rough)
        return self._simulator

    def by_engine_alone(self) -> tuple[MechanismSimulator, float]:
        """See `AbstractSystem`."""
        own = Models(self.recording, cores(), hard_friction=self._models.hard_friction, engine_steps=True)
        return MechanismSimulator(self.recording, own, own.file_step_s, self.simulator().threads), own.file_step_s

    def stretches(self, near: Effects = ()) -> tuple[Span, ...]:
        """See `AbstractSystem`; what a hit does bends whatever is in the model."""
        if near and not any(self._found_flights):
            return replayed(self._sensitive(self.simulator(), near), self.searched_s).spans
        if self._stretches is None:
            known = self._sensitive(self.simulator())
            if any(self._found_flights):
                lying = rests(self.recording, self.initial.coordinates, self.context.model)
                self._stretches = impact_stretches(known, self._found_flights, lying)
            else:
                self._cut = self._cut or replayed(known, self.searched_s)
                self._stretches = self._cut.spans
                known.simulator.survey_step_s = survey_step_s(known, self._stretches)
        return self._stretches

    @property
    def stretched_for_time(self) -> bool:
        """See `AbstractSystem`."""
        self.stretches()
        return self._cut is not None and not self._cut.bends

    def scatter(self) -> Scatter | None:
        """Return what impacts leave open, see `runner.systems.mechanism.scatter`; None: nothing hits anything."""
        if not any(self._found_flights):
            return None
        spans = self.stretches()
        of = RawSignals(
            tuple(self._raw.values[s.episode][s.begin : s.end] for s in spans),
            tuple(self._raw.valid[s.episode][s.begin : s.end] for s in spans),
            self._raw.sigma,
            spans,
        )
        starts = [self.initial.guess(of, i) for i in range(len(spans))]
        calm = tuple(np.zeros(len(e), bool) for e in self.recording.episodes)
        for span in (s for own in self._found_flights for s in own):
            calm[span.episode][span.begin : span.end] = True
        return scatter(self.simulator(), spans, starts, [c.group for c in self.channels], calm)

    def _flights(self) -> list[list[Span]]:
        """Return when bodies that are measured as a whole touch nothing, for each episode; none of other mechanisms."""
        coordinates, model = self.initial.coordinates, self.context.model
        if not measured_freely(self.recording, coordinates, model):
            return [[] for _ in self.recording.episodes]
        return flights(self.recording, coordinates, model)

    def label(self, signals: Signals, windows: Windows) -> Labels:
        """See `AbstractSystem`."""
        return label(self.recording, self._models, self.initial, self.context, signals, windows, self._found_flights)

    def phrase(self, factor: str, cell: str) -> str:
        """See `AbstractSystem`."""
        return super().phrase(factor, PHRASES.get(cell, cell) if factor == "regime" else cell)

    def missing_force_views(self, values: FloatArray, spread: FloatArray, labels: Labels) -> dict[str, FloatArray]:
        """Return the missing force of each joint along its motion: negative is friction that the model lacks."""
        out: dict[str, FloatArray] = {}
        for joint in self.initial.coordinates.joints:
            if joint.kind not in (HINGE, SLIDE):
                continue
            unit = "rad" if joint.kind == HINGE else "m"
            speed = labels.table[f"{joint.name}_{unit}_s"].to_numpy(float)
            slow = np.abs(speed) < 0.1 * self.context.speed[joint.name]
            name = f"along_{self.disturbance.names[joint.v.start]}"
            out[name] = np.where(slow, np.nan, np.sign(speed) * values[:, joint.v.start])
            out[f"{name}_se"] = np.where(slow, np.nan, np.sqrt(spread[:, joint.v.start, joint.v.start]))
        return out

    def force_shapes(self, missing: pd.DataFrame) -> dict[str, dict[str, FloatArray]]:
        """See `AbstractSystem`."""
        return force_shapes(self.recording, self.initial.coordinates, self.disturbance.names, missing)

    def proposals(self) -> tuple[Sequence[Trial], AbstractSystem, FloatArray]:
        """Return steps, ramps, sines and reversals of each actuator, from where the episodes usually began."""
        found = trials(self.recording, self.context.model)
        system = _Unmeasured(self, unmeasured(self.recording, self.context.model, found))
        starts = np.array([self.initial.guess(self._raw, e) for e in range(len(self.recording.episodes))])
        nv = self.initial.coordinates.nv
        return found, system, np.concatenate([np.median(starts[:, :nv], axis=0), np.zeros(nv)])

    def model_use(self, effects: Effects) -> str:
        """See `AbstractSystem`."""
        needed = needing_law(self._models, effects)
        law = f', loaded by `import model; m = model.load("model.xml")` with {LAW} beside it' if needed else ""
        left = "; what is no part of a model its first lines name" if left_out(self._models, effects) else ""
        return f"runs in plain MuJoCo{law}{left}"

    def write_model(self, effects: Effects, folder: Path) -> tuple[str, ...]:
        """See `AbstractSystem`."""
        return write_model(self._models, effects, folder)

    def drawn(self) -> tuple[DrawnBody, ...]:
        """See `AbstractSystem`."""
        return drawn_bodies(self.context.model)

    def poses(self, episode: int, channels: FloatArray) -> dict[str, FloatArray]:
        """See `AbstractSystem`."""
        return body_poses(self.context.model, self.initial.positions(episode, channels))

    def with_values(self, values: Sequence[FloatArray]) -> MechanismSystem:
        """Return the same system with other measurements, (T, C) per episode."""
        episodes = tuple(replace(e, values=v) for e, v in zip(self.recording.episodes, values, strict=True))
        recording = replace(self.recording, episodes=episodes)
        return MechanismSystem(recording, step_s=self.step_s, hard_friction=self._models.hard_friction)


class _Unmeasured(MechanismSystem):
    """Experiments that have not been done: a mechanism that knows of itself what another has shown."""

    def __init__(self, known: MechanismSystem, recording: MechanismRecording) -> None:
        self.recording = recording
        self.channels, self.rate_hz = known.channels, known.rate_hz
        self._models, self._raw, self.initial = known._models, known._raw, known.initial
        self.context, self.vocabulary, self.disturbance = known.context, known.vocabulary, known.disturbance
        self._step_s: float | None = known.step_s
        self._simulator, self._dispersion = None, known._dispersion
        self._cut, self._stretches, self._found_flights = None, None, [[] for _ in recording.episodes]


def read_mechanism(path: str | Path) -> MechanismSystem:
    """Return the mechanism of a case in model form.

    Args:
        path: A folder with a recording, an MJCF and `nominal.yaml`, or the table in it.

    Raises:
        RecordingError: With the file, the row or key, what was wrong, and what is allowed.
    """
    return MechanismSystem(with_episode_to_check(read_model_case(path)))


def _channel(source: ChannelSource) -> Channel:
    """Return how a channel is called, and with which others it shares its noise."""
    kind = {"joint": "joint", "actuator": "actuator", "body": "body", "sensor": f"sensor {source.target}"}[source.kind]
    group = kind if source.kind == "sensor" else f"{kind} {source.quantity.replace('_', ' ')} of {source.target}"
    words = source.quantity.replace("_", " ")
    label = {
        "joint": f"{words} of '{source.target}'",
        "actuator": f"force of actuator '{source.target}'",
        "body": f"{'xyz'[source.index]} {words} of '{source.target}'",
        "sensor": f"sensor '{source.target}'" + (f" [{source.index}]" if source.index else ""),
    }[source.kind]
    space = Space.LINE
    if source.quantity == "orientation":
        space = Space.ROTATION
    elif source.kind == "joint" and source.quantity == "position" and source.unit == "rad":
        space = Space.CIRCLE
    return Channel(source.name, source.unit, group, label, space)


def _to_set(values: Sequence[float], has: np.ndarray) -> str:
    """Return an attribute of MJCF without the last numbers that all joints have anyway, as MuJoCo writes it.

    Args:
        values: What it is to be, (k,).
        has: What it is in each of the joints, (joints, k).
    """
    other = np.flatnonzero((np.asarray(has) != np.asarray(values)).any(axis=0))
    return attribute(*values[: max(int(other[-1]) + 1 if len(other) else 0, 1)])
