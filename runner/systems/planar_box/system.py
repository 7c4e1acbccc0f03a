"""The planar box: a rigid box on a flat floor, pushed by known forces, seen from above."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from runner.effects.base import Effects
from runner.effects.planar_box import EFFECTS, BodySize, DeadBand
from runner.effects.vocabulary import Candidate, Vocabulary
from runner.effects.wording import number
from runner.errors import RecordingError
from runner.numerics.arrays import FloatArray
from runner.physics.dry_friction import STATE
from runner.recording import Form, Recording, Span, Support
from runner.recording.force_noise import pushing_noise
from runner.settings import SETTINGS
from runner.systems.base import AbstractSystem, Proposal
from runner.systems.channels import Channel, Signals, Space
from runner.systems.disturbance import Disturbance
from runner.systems.drawing import DrawnBody, Shape
from runner.systems.planar_box.initial import PlanarStart
from runner.systems.planar_box.labels import FACTORS, REGIMES, label
from runner.systems.planar_box.misread import in_other_units
from runner.systems.planar_box.model_file import write_model
from runner.systems.planar_box.motion import measured_columns, state_columns
from runner.systems.planar_box.pin_force import measured_force
from runner.systems.planar_box.pin_proposals import pin_pushes, unmeasured_by_pin
from runner.systems.planar_box.proposals import pushes, unmeasured
from runner.systems.planar_box.rests import pin_rest_segments, rest_segments
from runner.systems.planar_box.simulator import OBJECT, Simulator, context_of
from runner.systems.planar_box.windows import planar
from runner.systems.raw_signals import RawSignals, raw
from runner.systems.stretches import Sensitive, halved
from runner.systems.windows import Labels, Windows

CHANNELS = (
    Channel("x", "m", "position", "position x"),
    Channel("y", "m", "position", "position y"),
    Channel("yaw", "rad", "yaw", "heading", Space.CIRCLE),
    Channel("vx", "m/s", "velocity", "velocity x"),
    Channel("vy", "m/s", "velocity", "velocity y"),
    Channel("wz", "rad/s", "rate", "yaw rate"),
    Channel("fx", "N", "force", "force of the pin x"),
    Channel("fy", "N", "force", "force of the pin y"),
)
PIN, PIN_DRAWN_HEIGHTS = "pin", 3.0  # as it is drawn, and how many times as high as the body


def vocabulary(*, pin: bool = False) -> Vocabulary:
    """Return every effect that is registered for a box that forces push, or a pin, whoever has written it."""
    classes = [cls for variants in EFFECTS.values() for cls in variants if not (cls.of_command if pin else cls.of_pin)]
    known = tuple(Candidate(cls, getattr(cls, "target", None)) for cls in classes)
    outside = () if pin else (Candidate(DeadBand),)
    return Vocabulary(known, outside=outside, uncertain=(Candidate(BodySize),))


class PlanarBox(AbstractSystem):
    """A planar recording of a box, see `AbstractSystem`."""

    regimes = REGIMES
    factors = FACTORS
    activities = ("regime", "push")
    noun = "body"
    experiment = "push"
    reach = "the forces used so far"
    reach_further = "push harder, or elsewhere, or check it by hand"
    # floors are never even: their texture is never below half of a hundredth of an effect's usual size
    mismatch_levels = (0.5, 1.0, 2.0, 4.0, 8.0)
    # a floor, a box and a push: what more than three effects explain is something else; errors stay where they are made
    most_effects = 3
    dates_disturbances = False  # a box is touched by all that pushes it: its commands are that
    worth_another = 0.5
    # so much tells what there is to tell, and the time that a search takes grows with it
    searched_s = 120.0
    cut_from = float("inf")
    plan_view = (0, 1)
    force_views = MappingProxyType({"along_n": "along the motion [N]", "left_n": "left of the motion [N]"})
    recording: Recording

    def __init__(self, recording: Recording) -> None:
        """Bind to a recording.

        Raises:
            RecordingError: If it is not planar.
        """
        if recording.form is not Form.PLANAR:
            raise RecordingError(f"{recording.path}: only planar recordings (x, y, yaw) can be replayed.")
        self.recording = recording
        self.beliefs = recording.nominal
        every = vocabulary(pin=recording.nominal.pin is not None)
        self.vocabulary = every.without(recording.nominal.known, recording.nominal.path)
        self.rate_hz = recording.nominal.rate_hz
        self._columns = measured_columns(recording)
        self.channels = tuple(CHANNELS[k] for k in self._columns)
        self.initial = PlanarStart(self.rate_hz, state_columns(recording))
        self.context = context_of(recording)
        force = SETTINGS.where.force_step * self.context.friction_n
        large = SETTINGS.where.max_force * max(self.context.friction_n, self.context.force_n)
        arm = np.array([1.0, 1.0, self.context.size_m])
        self.disturbance = Disturbance(
            ("fx_n", "fy_n", "mz_n_m"),
            ("towards world x [N]", "towards world y [N]", "moment about z [N m]"),
            force * arm,
            large * arm,
        )
        self._simulator: Simulator | None = None
        self._stretches: dict[Effects, tuple[Span, ...]] = {}

    def values(self) -> tuple[FloatArray, ...]:
        """See `AbstractSystem`."""
        every = (np.hstack([e.pose, e.twist, measured_force(e)]) for e in self.recording.episodes)
        return tuple(each[:, self._columns] for each in every)

    def stated_noise(self) -> FloatArray:
        """See `AbstractSystem`."""
        noise = self.recording.nominal.noise
        given = {
            "position": noise.position_m,
            "yaw": noise.yaw_rad,
            "velocity": noise.velocity_m_s,
            "rate": noise.rate_rad_s,
            "force": None,
        }
        return np.array([np.nan if given[c.group] is None else given[c.group] for c in self.channels], float)

    def misread(self) -> tuple[str, ...]:
        """See `AbstractSystem`; where a pin pushes, its path says how far the box goes, in whatever unit."""
        if self.recording.nominal.pin is not None:
            return ()

        def replay(values: Sequence[FloatArray], windows: Windows) -> FloatArray:
            starts = self.initial.guess_windows(self._signals(values), windows, smooth=True)
            with np.errstate(invalid="ignore", over="ignore"):
                return self.simulator().predict_windows((), windows, starts[:, None])[:, 0]

        return tuple(in_other_units(self.channels, self.values(), self.rate_hz, replay))

    def rests(self) -> list[tuple[int, slice]]:
        """See `AbstractSystem`."""
        pin = self.recording.nominal.pin
        return [
            (e, s)
            for e, episode in enumerate(self.recording.episodes)
            for s in (rest_segments(episode) if pin is None else pin_rest_segments(episode, pin.radius_m))
        ]

    def stretches(self, near: Effects = ()) -> tuple[Span, ...]:
        """See `AbstractSystem`."""
        if near not in self._stretches:
            signals = self._signals(self.values())
            usual = self.context.friction_n * np.array([1.0, 1.0, self.context.size_m])
            known = Sensitive(self.recording, self.simulator(), self.initial, usual, signals, near)
            self._stretches[near] = halved(known)
        return self._stretches[near]

    def _signals(self, values: Sequence[FloatArray]) -> RawSignals:
        """Return measured channels, (T, C) of each episode, with a rough level of noise where none is stated."""
        return raw(values, [e.t_s for e in self.recording.episodes], self.stated_noise(), values)

    def simulator(self, *, threads: int | None = None) -> Simulator:
        """See `AbstractSystem`."""
        if self._simulator is None or (threads is not None and threads != self._simulator.threads):
            self._simulator = Simulator(self.recording, threads=threads)
        return self._simulator

    @property
    def has_noisy_drive(self) -> bool:
        """See `AbstractSystem`: forces that a sensor has measured are; where a pin pushes, its path decides."""
        return bool(self._drive_noise_n().any())

    def driven_otherwise(self, draws: int) -> tuple[PlanarBox, ...]:
        """See `AbstractSystem`."""
        if not self.has_noisy_drive:
            return ()
        noise_n = self._drive_noise_n()
        return tuple(PlanarBox(_noisier(self.recording, noise_n, seed)) for seed in range(draws))

    def _drive_noise_n(self) -> FloatArray:
        """Return the noise of the force along world x and y, (2,), N."""
        if self.recording.nominal.pin is not None:
            return np.zeros(2)
        return pushing_noise(e.force_n[:, :2] for e in self.recording.episodes)

    def label(self, signals: Signals, windows: Windows) -> Labels:
        """See `AbstractSystem`."""
        return label(self.recording, self.context, signals, windows)

    def phrase(self, factor: str, cell: str) -> str:
        """See `AbstractSystem`."""
        phrase = super().phrase(factor, cell)
        return f"when {phrase}" if phrase.startswith(("pushed", "coasting", "spinning", "stuck")) else phrase

    def missing_force_views(self, values: FloatArray, spread: FloatArray, labels: Labels) -> dict[str, FloatArray]:
        """Return the force along the body's axes, and along and left of the motion, N."""
        yaw = labels.table["yaw_rad"].to_numpy(float)
        moves = labels.table["heading in the world"].map(lambda h: isinstance(h, str)).to_numpy(bool)
        velocity = labels.table[["vx_m_s", "vy_m_s"]].to_numpy(float)
        heading = np.where(moves, np.arctan2(velocity[:, 1], velocity[:, 0]), np.nan)
        out: dict[str, FloatArray] = {}
        for names, angle in ((("fx_body_n", "fy_body_n"), yaw), (("along_n", "left_n"), heading)):
            turn = np.stack(
                [np.stack([np.cos(angle), np.sin(angle)], 1), np.stack([-np.sin(angle), np.cos(angle)], 1)], 1
            )
            turned = np.einsum("wij,wj->wi", turn, values[:, :2])
            error = np.sqrt(np.einsum("wij,wjk,wik->wi", turn, spread[:, :2, :2], turn))
            for i, name in enumerate(names):
                out[name], out[f"{name}_se"] = turned[:, i], error[:, i]
        return out

    def proposals(self) -> tuple[Sequence[Proposal], AbstractSystem, FloatArray]:
        """Return pushes from rest in the middle of the floor that was visited."""
        start = np.zeros(self.initial.size)
        start[:2] = self.context.centre_m
        if self.recording.nominal.pin is None:
            found: Sequence[Proposal] = (by_force := pushes(self.recording, self.context))
            recording = unmeasured(self.recording, by_force)
        else:
            found = by_pin = pin_pushes(self.recording, self.context)
            recording = unmeasured_by_pin(self.recording, by_pin, start[:2]) if by_pin else self.recording
        system = PlanarBox(recording)
        system.context = self.context
        return found, system, start

    def model_use(self, effects: Effects) -> str:
        """See `AbstractSystem`."""
        return (
            "runs in plain MuJoCo, pushed by `mujoco.mj_applyFT` as docs/contact.md shows; what MJCF can't express its "
            "first lines name"
        )

    def write_model(self, effects: Effects, folder: Path) -> tuple[str, ...]:
        """See `AbstractSystem`."""
        return write_model(planar(effects), folder, self.simulator())

    def drawn(self) -> tuple[DrawnBody, ...]:
        """Return the box, with a mark on its top that shows the heading."""
        nominal = self.recording.nominal
        hx, hy, hz = nominal.half_size_m
        mark = Shape("box", (0.12 * hx, 0.3 * hy, 0.01 * hz), (0.75 * hx, 0.0, hz))
        shape = "box" if nominal.outline is None else "prism"
        body = DrawnBody(OBJECT, (Shape(shape, (hx, hy, hz), outline=nominal.outline), mark))
        if nominal.pin is None:
            return (body,)
        return (body, DrawnBody(PIN, (Shape("cylinder", (nominal.pin.radius_m, PIN_DRAWN_HEIGHTS * hz)),)))

    def poses(self, episode: int, channels: FloatArray) -> dict[str, FloatArray]:
        """See `AbstractSystem`."""
        half = channels[:, 2] / 2
        height = np.full(len(channels), self.recording.nominal.half_size_m[2])
        zero = np.zeros(len(channels))
        poses = {
            OBJECT: np.column_stack([channels[:, 0], channels[:, 1], height, np.cos(half), zero, zero, np.sin(half)])
        }
        path = self.recording.episodes[episode].pin_m
        if path is not None:
            poses[PIN] = np.column_stack([path, PIN_DRAWN_HEIGHTS * height, zero + 1.0, zero, zero, zero])
        return poses

    def believed(self) -> tuple[tuple[str, str], ...]:
        """See `AbstractSystem`."""
        nominal = self.recording.nominal
        size = " × ".join(number(2 * h) for h in nominal.half_size_m)
        pin = nominal.pin
        pushed: tuple[tuple[str, str], ...] = ()
        if pin is not None:
            at = f"{number(abs(pin.height_m))} m {'above' if pin.height_m > 0 else 'below'}" if pin.height_m else "at"
            said = f"radius {pin.radius_m:.4g} m, friction {pin.friction:.3g}, {at} the height of the geometric centre"
            pushed = (("pin", said),)
        borne = "under the whole base" if nominal.contact is Support.PATCH else "at the corners"
        return (
            ("object", f"{'box' if nominal.outline is None else 'plate'} of {size} m, {number(nominal.mass_kg)} kg"),
            ("friction", f"{nominal.friction:.3g}, {borne}"),
            ("gravity", f"{nominal.gravity_m_s2:.4g} m/s²"),
            *pushed,
        )

    def command_arrows(self, episode: int, channels: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the pushes, at the height of the box's middle; see `AbstractSystem`."""
        recorded = self.recording.episodes[episode]
        force, point = np.nan_to_num(recorded.force_n), np.nan_to_num(recorded.point_m)
        c, s = np.cos(channels[:, 2]), np.sin(channels[:, 2])
        x = channels[:, 0] + c * point[:, 0] - s * point[:, 1]
        y = channels[:, 1] + s * point[:, 0] + c * point[:, 1]
        height = np.full(len(channels), self.recording.nominal.half_size_m[2])
        return np.column_stack([x, y, height]), np.column_stack([force[:, :2], np.zeros(len(force))])

    def with_values(self, values: Sequence[FloatArray]) -> PlanarBox:
        """Return the same system with other measurements, (T, C) per episode."""
        episodes = []
        for episode, measured in zip(self.recording.episodes, values, strict=True):
            every = np.full((len(measured), len(CHANNELS)), np.nan)
            every[:, self._columns] = measured
            force = (
                episode.force_n if self.recording.nominal.pin is None else np.pad(every[:, STATE:], ((0, 0), (0, 1)))
            )
            episodes.append(replace(episode, pose=every[:, :3], twist=every[:, 3:STATE], force_n=force))
        return PlanarBox(replace(self.recording, episodes=tuple(episodes)))


def _noisier(recording: Recording, noise_n: FloatArray, seed: int) -> Recording:
    """Return a recording with more noise on its forces, of such a standard deviation along world x and y, (2,), N."""
    draw = np.random.default_rng(seed)

    def pushed(force_n: FloatArray) -> FloatArray:
        out = np.nan_to_num(force_n)
        out[:, :2] += noise_n * draw.standard_normal((len(out), 2))
        return out

    return replace(recording, episodes=tuple(replace(e, force_n=pushed(e.force_n)) for e in recording.episodes))
