"""Open-loop simulation of a recording: its commands through the believed model, with or without effects.

A batch of models (one per set of effects), start states and commands of episodes runs on all cores: in
`mujoco.rollout`, or where the friction of the base is all that acts in `dry_friction.rollout`, which is the same to
rounding. Effects outside the engine change the command before and the measurement after.
"""

from __future__ import annotations

import copy
import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
from dm_control.mjcf import RootElement
from mujoco import rollout

from runner.effects.base import AbstractEffect
from runner.effects.planar_box import Context, PlanarEffect, Target
from runner.errors import RecordingError
from runner.physics import dry_friction
from runner.physics.scene import Base, BodyConfig, Dof, PinConfig, SceneConfig, build
from runner.recording import Form, Nominal, Recording, Span, Support
from runner.recording.model_form_mjcf import quiet
from runner.systems.planar_box.commands import Commands
from runner.systems.planar_box.motion import begun_ahead, measured_columns, read_ahead, read_at_steps, simulated_columns
from runner.systems.planar_box.pin_force import means, steps_of_engine
from runner.systems.planar_box.windows import (
    BYTES_AT_ONCE,
    FULL,
    USERDATA,
    Effects,
    WindowSimulator,
    planar,
    shown_alike,
    unseen,
)
from runner.systems.simulator import AbstractSimulator, Run, alike, of_each
from runner.systems.windows import Windows

OBJECT = "object"
STEP_RATE_HZ = 120.0  # at least so many physics steps a second: pose errors are then below 0.1 mm (second order)
PIN_STEP_RATE_HZ = 1000.0  # where a pin pushes, whose contact is of first order and rolls on in between
MODELS = 128  # kept for the next span
KEPT_WINDOWS = 4  # models that are ready for windows: as believed, corrected
BASE_POINTS = 8  # along each edge: everything replays the same base
PIN_BASE_POINTS = 6  # where a pin pushes the steps' own error outweighs that of fewer points
SPEED_OVER_S = 0.1  # noise of a position is small beside the way of a box in that time
# Of surveys: how a prediction changes with an effect is told to some percent by half the steps and points, whose own
# errors, of second order in the steps and of the sixth in the points, are the same with the effect and without.
SURVEY_RATE_HZ, PIN_SURVEY_RATE_HZ, SURVEY_POINTS = 60.0, 250.0, 5


@dataclass(frozen=True)
class _Compiled:
    """A model with its structural elements, holding the nominal numbers."""

    model: mujoco.MjModel
    body_id: int
    data: tuple[mujoco.MjData, ...]  # one per thread


@dataclass(frozen=True)
class _Asked:
    """A run of a span; its length is that of its samples."""

    span: Span
    run: Run

    def __len__(self) -> int:
        return self.span.end - self.span.begin


def body_of(nominal: Nominal) -> BodyConfig:
    """Return the box that the owner of a recording believes in."""
    inertia = nominal.inertia_kg_m2
    if isinstance(inertia, float | int):
        # only the yaw inertia is known; the others don't move a planar body
        inertia = (float(inertia), float(inertia), float(inertia))
    elif inertia is None and nominal.outline is not None:
        turning = nominal.yaw_inertia_kg_m2
        inertia = (turning, turning, turning)
    return BodyConfig(
        mass_kg=nominal.mass_kg,
        friction=nominal.friction,
        half_size_m=nominal.half_size_m,
        com_m=nominal.centre_of_mass_m,
        inertia_kg_m2=inertia,
        base=Base.corners if nominal.contact is Support.CORNERS else Base.even,
    )


def context_of(recording: Recording) -> Context:
    """Return what effects may know of a recording: the believed body, and where and how hard it was pushed."""
    place = np.concatenate([e.pose[:, :2] for e in recording.episodes])
    # a glitch of the tracking must not stretch the floor
    low, high = np.nanquantile(place, [0.002, 0.998], axis=0)
    force = max(float(np.nan_to_num(np.linalg.norm(e.force_n, axis=1)).max(initial=0.0)) for e in recording.episodes)
    nominal = recording.nominal
    return Context(
        mass_kg=nominal.mass_kg,
        friction=nominal.friction,
        half_size_m=nominal.half_size_m,
        gravity_m_s2=nominal.gravity_m_s2,
        centre_m=(float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2),
        reach_m=max(float(np.max(high - low)) / 2, max(nominal.half_size_m)),
        force_n=max(force, 1e-6),
        pin_friction=None if nominal.pin is None else nominal.pin.friction,
        pin_height_m=0.0 if nominal.pin is None else nominal.pin.height_m,
        speed_m_s=_fastest_m_s(recording),
    )


def _fastest_m_s(recording: Recording) -> float:
    """Return the fastest that a body moved, m/s, but for glitches of its tracking."""
    speeds = []
    for e in recording.episodes:
        apart = min(max(1, round(SPEED_OVER_S / e.step_s)), len(e) - 1)
        way_m = np.linalg.norm(e.pose[apart:, :2] - e.pose[: len(e) - apart, :2], axis=1)
        # one position that is far off is in two ways, which are no neighbours
        speeds.append(np.median([way_m, np.roll(way_m, 1), np.roll(way_m, -1)], axis=0) / (apart * e.step_s))
    every = np.concatenate(speeds)
    return float(np.nanquantile(every, 0.998)) if np.isfinite(every).any() else 0.0


@dataclass
class Simulator(AbstractSimulator):
    """Simulates the episodes of a planar recording; a start is x, y, yaw, vx, vy, wz.

    Args:
        recording: The case.
        step_rate_hz: At least so many physics steps a second, a whole number of them per sample; None: as many as the
            kind of push needs.
        grid: Base points along each edge; None: as many as the kind of push needs.
        threads: For the rollouts; None: one per core.
        spans: What is simulated, each on its own, with all that was commanded before; None: every episode.

    Raises:
        RecordingError: If the recording is not planar.
    """

    recording: Recording
    step_rate_hz: float | None = None
    grid: int | None = None
    threads: int | None = None
    spans: tuple[Span, ...] | None = None
    steps_per_sample: int = field(init=False)
    step_s: float = field(init=False)
    simulated_s: float = field(init=False, default=0.0)  # how much has been simulated so far, for benchmarks

    def __post_init__(self) -> None:
        if self.recording.form is not Form.PLANAR:
            raise RecordingError(f"{self.recording.path}: only planar recordings (x, y, yaw) can be replayed.")
        rate, pin = self.recording.nominal.rate_hz, self.recording.nominal.pin is not None
        if self.step_rate_hz is None:
            self.step_rate_hz = PIN_STEP_RATE_HZ if pin else STEP_RATE_HZ
        self._points = self.grid or (PIN_BASE_POINTS if pin else BASE_POINTS)
        self.steps_per_sample = max(1, int(np.ceil(self.step_rate_hz / rate - 1e-9)))
        self.step_s = 1.0 / rate / self.steps_per_sample
        self._threads = self.threads or len(os.sched_getaffinity(0))
        self._pool = rollout.Rollout(nthread=self._threads if self._threads > 1 else 0)
        self._compiled: dict[tuple[type[PlanarEffect], ...], _Compiled] = {}
        self._models: dict[Effects, mujoco.MjModel] = {}  # the latest, as many spans are simulated with the same
        self._commands = Commands(self.recording, self.steps_per_sample, self.step_s)
        self._windows: dict[Effects, WindowSimulator] = {}
        whole = tuple(Span(i, 0, len(e)) for i, e in enumerate(self.recording.episodes))
        self._columns_seen = measured_columns(self.recording)
        self._simulated = simulated_columns(self._columns_seen)
        self._spans = whole if self.spans is None else self.spans
        self._surveyor: Simulator | None = None

    def mjcf(self, effects: Effects) -> RootElement:
        """Return the MJCF of the believed body with the elements that structural effects add."""
        scene = SceneConfig(
            dof=Dof.planar,
            timestep_s=self.step_s,
            gravity_m_s2=self.recording.nominal.gravity_m_s2,
            grid=self._points,
        )
        nominal = self.recording.nominal
        outlines = {} if nominal.outline is None else {OBJECT: nominal.outline}
        pin = nominal.pin
        pins = {} if pin is None else {OBJECT: PinConfig(pin.radius_m, pin.friction, pin.height_m)}
        root = build(scene, {OBJECT: body_of(nominal)}, outlines, pins)
        for effect in effects:
            effect.edit_mjcf(root, OBJECT)
        return root

    def model(self, effects: Effects) -> mujoco.MjModel:
        """Return the compiled model with these effects in it."""
        base = self._base(effects)
        model = copy.copy(base.model)
        target = Target(model, base.body_id, base.data[0])
        for effect in effects:
            effect.edit_model(target)
        return model

    def _base(self, effects: Effects) -> _Compiled:
        key = tuple(type(e) for e in effects if e.structural)
        if key not in self._compiled:
            root = self.mjcf(effects)
            model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
            data = tuple(mujoco.MjData(model) for _ in range(max(self._threads, 1)))
            self._compiled[key] = _Compiled(model, model.body(OBJECT).id, data)
        return self._compiled[key]

    def parts(self, spans: Sequence[Span]) -> Simulator:
        """Return a simulator of parts of what this one simulates; `episode` counts what that is."""
        whole = [self._spans[s.episode] for s in spans]
        begins = [w.begin for w in whole]
        spans = tuple(Span(w.episode, b + s.begin, b + s.end) for w, b, s in zip(whole, begins, spans, strict=True))
        return replace(self, spans=spans)

    def surveying(self) -> Simulator:
        """See `AbstractSimulator`."""
        if self._surveyor is None:
            survey_hz = SURVEY_RATE_HZ if self.recording.nominal.pin is None else PIN_SURVEY_RATE_HZ
            step_rate_hz = min(self.step_rate_hz or survey_hz, survey_hz)
            self._surveyor = replace(self, step_rate_hz=step_rate_hz, grid=min(self._points, SURVEY_POINTS))
        return self._surveyor

    def predict_each(self, asked: Sequence[tuple[int, Sequence[Run]]]) -> list[np.ndarray]:
        """See `AbstractSimulator`.

        Pose, then twist, then the force of a pin. That has a sensor of its own, which effects on the measured motion
        leave alone; a delay, of commands or of all that is measured, is in it.
        """
        spans = [self._spans[episode] for episode, _ in asked]
        every = [_Asked(s, run) for s, (_, runs) in zip(spans, asked, strict=True) for run in runs]
        groups: dict[tuple[type[PlanarEffect], ...], list[int]] = {}
        for i, one in enumerate(every):
            groups.setdefault(tuple(type(e) for e in planar(one.run.effects) if e.structural), []).append(i)
        found: dict[int, np.ndarray] = {}
        for group in groups.values():
            for members in alike([len(every[i]) for i in group]):
                for some in self._at_once([group[m] for m in members], every):
                    found |= zip(some, self._predict([every[i] for i in some]), strict=True)
        rows = (found[i][:, self._columns_seen] for i in range(len(every)))
        return of_each(rows, asked, spans, len(self._columns_seen))

    def _at_once(self, members: Sequence[int], every: Sequence[_Asked]) -> list[Sequence[int]]:
        """Return runs in parts of which the commands take no more memory than they may."""
        bytes_each = 8.0 * len(every[members[0]]) * self.steps_per_sample * dry_friction.USERDATA_SIZE
        size = max(1, int(BYTES_AT_ONCE / bytes_each))
        return [members[k : k + size] for k in range(0, len(members), size)]

    def _predict(self, asked: Sequence[_Asked]) -> list[np.ndarray]:
        """Return what would be measured of runs of about one length, of models of one structure, each (T, C)."""
        base = self._base(planar(asked[0].run.effects))
        before = [a.span.begin * self.steps_per_sample for a in asked]
        steps = [(len(a) - 1) * self.steps_per_sample for a in asked]
        n = max(steps)
        if len(self._models) > MODELS:
            self._models.clear()
        start = np.zeros((len(asked), mujoco.mj_stateSize(base.model, FULL)))
        members, driven = dict[Effects, list[int]](), dict[tuple[Effects, Span], int]()
        which, by = np.empty(len(asked), int), np.empty(len(asked), int)
        for i, (span, run) in enumerate((a.span, a.run) for a in asked):
            effects = planar(run.effects)
            members.setdefault(effects, []).append(i)
            by[i] = driven.setdefault((self._commands.acting(effects), span), len(driven))
            start[i, 0] = before[i] * self.step_s
            start[i, 1:7] = run.start
            # half a step ahead: MuJoCo's pose is then the one at the middle of each step (leapfrog), second order
            start[i, 1:4] += 0.5 * self.step_s * run.start[3:]
        for k, (effects, own) in enumerate(members.items()):
            which[own] = k
            if effects not in self._models:
                self._models[effects] = self.model(effects)
        models = [self._models[effects] for effects in members]
        controls = np.empty((len(driven), n, dry_friction.USERDATA_SIZE))
        for (effects, span), k in driven.items():
            first, last = span.begin * self.steps_per_sample, (span.end - 1) * self.steps_per_sample
            own = self._commands.control(effects, span.episode)[first:last]
            controls[k, : len(own)], controls[k, len(own) :] = own, own[-1:]
        shares = np.array([[read_ahead(planar(a.run.effects), self.step_s)] for a in asked])

        def begin(state: np.ndarray, first: np.ndarray) -> np.ndarray:
            self.simulated_s += self.step_s * len(asked)
            return self._after(base, models, first, state, which, by)

        start[:, 1:7] = begun_ahead(start, controls, shares, self.step_s, begin)
        after = self._after(base, models, controls, start, which, by)
        self.simulated_s += n * self.step_s * len(asked)
        out = np.empty((len(asked), n // self.steps_per_sample + 1, self._simulated))
        for effects, own in members.items():
            measured = read_at_steps(start[own, 1:7], after[own], self.step_s, effects)
            sampled = slice(None, None, self.steps_per_sample)
            out[own, :, :3], out[own, :, 3:6] = measured.pose[:, sampled], measured.twist[:, sampled]
        if self._simulated > dry_friction.STATE:
            for i, count in enumerate(steps):  # what comes after the end has no share in a mean
                out[i, : len(asked[i]), 6:] = means(after[i, :count, 6:], self.steps_per_sample, self.step_s)
        return [rows[: len(a)] for rows, a in zip(out, asked, strict=True)]

    def _after(
        self,
        base: _Compiled,
        models: Sequence[mujoco.MjModel],
        controls: np.ndarray,
        start: np.ndarray,
        which: np.ndarray,
        by: np.ndarray,
    ) -> np.ndarray:
        """Return the state after each step of some runs, (R, n, 6) or more columns.

        Args:
            base: What the models have in common.
            models: Of different effects.
            controls: Commands of different runs, (D, n, ...).
            start: Of each run, (R, ...).
            which: Which model is a run's, (R,).
            by: Which commands are, (R,).
        """
        if dry_friction.is_all_that_acts(base.model):
            return dry_friction.rollout(
                models, controls, start[:, :7], (which, by), self._threads, columns=self._simulated
            )
        each = [models[k] for k in which]
        if self._simulated > dry_friction.STATE:
            return steps_of_engine(each, base.data[0], start, controls[by])
        with quiet():  # what runs away is told by its residuals
            state, _ = self._pool.rollout(
                each, list(base.data), start, controls[by], control_spec=USERDATA, chunk_size=1
            )
        return state[:, :, 1:7]

    def predict_windows(
        self,
        effects: Sequence[AbstractEffect],
        windows: Windows,
        starts: np.ndarray,
        disturbance: np.ndarray | None = None,
    ) -> np.ndarray:
        """See `AbstractSimulator`; a disturbance is a force through the geometric centre, N, world, and a moment."""
        effects = shown_alike(planar(effects))
        if effects not in self._windows:
            if len(self._windows) >= KEPT_WINDOWS:
                self._windows.clear()
            self._windows[effects] = WindowSimulator(self._commands, self.model(effects), effects)
        one = self._windows[effects]
        before = one.simulated_s
        out = one.predict(windows, starts, disturbance)
        self.simulated_s += one.simulated_s - before
        return out

    def seen_start(self, effects: Sequence[AbstractEffect], start: np.ndarray) -> np.ndarray:
        """See `AbstractSimulator`."""
        return unseen(planar(effects), start, self.step_s)
