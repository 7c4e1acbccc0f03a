"""The experiment as values: what is simulated, with what truth, from what start, over what link, with what rule.

`CompiledExperiment` is its compiled form: one model with the remote cube and a local cube for each estimator, all in
the same place and not touching one another, and the commands of every physics step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from dm_control.rl.control import PhysicsError

from runner.config import registered, snake_case, with_key
from runner.effects.base import in_stages
from runner.effects.planar_box import EFFECTS, PlanarEffect, Target
from runner.errors import ConfigError, check_range, check_vector
from runner.physics import dry_friction, player
from runner.physics.forces import AbstractForces
from runner.physics.scene import BodyConfig, BodyHandle, SceneConfig, build, check_inertia, handles, push_columns
from runner.teleop.estimators import AbstractEstimator
from runner.teleop.follow import AbstractFollow, Immediate
from runner.teleop.frames import Truth
from runner.teleop.link import LinkConfig, update_steps
from runner.teleop.parameters import truths

REMOTE = "remote"
STEPS = 5_000_000  # of a run: some hours at the usual 2 ms, and 2 GB of commands

for _classes in EFFECTS.values():
    for _class in (c for c in _classes if not c.of_pin):  # cubes are pushed by forces
        registered("effect", snake_case(_class.__name__))(_class)

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class RemoteConfig:
    """The remote cube as it truly is. `inertia_kg_m2` None: that of a uniform box of its mass."""

    mass_kg: float = 3.0
    half_size_m: Vector = (0.5, 0.5, 0.5)
    com_m: Vector = (0.0, 0.0, 0.0)
    inertia_kg_m2: Vector | None = None
    friction: float = 0.3
    effects: dict[str, PlanarEffect] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _ = self.body  # checks the ranges

    @property
    def body(self) -> BodyConfig:
        """The remote cube without its effects."""
        return BodyConfig(self.mass_kg, self.friction, self.half_size_m, self.com_m, self.inertia_kg_m2)


@dataclass(frozen=True)
class StartConfig:
    """What the local side believes at the start.

    `com_m` None: the geometric centre. `inertia_kg_m2` None: that of a uniform box; it scales with the mass (eq. 3 of
    the paper). `friction` None: the remote's. The local cube has the remote's size.
    """

    mass_kg: float = 1.0
    com_m: Vector | None = None
    inertia_kg_m2: Vector | None = None
    friction: float | None = None

    def __post_init__(self) -> None:
        check_range("mass_kg", self.mass_kg, 0.0, 1e6, unit="kg", lower_open=True)
        if self.com_m is not None:
            check_vector("com_m", self.com_m, 3, unit="m", limit=100.0)
        if self.inertia_kg_m2 is not None:
            check_inertia("inertia_kg_m2", self.inertia_kg_m2)
        if self.friction is not None:
            check_range("friction", self.friction, 0.0, 10.0)

    def body(self, remote: RemoteConfig) -> BodyConfig:
        """The local cube at the start."""
        return BodyConfig(
            mass_kg=self.mass_kg,
            friction=remote.friction if self.friction is None else self.friction,
            half_size_m=remote.half_size_m,
            com_m=self.com_m or (0.0, 0.0, 0.0),
            inertia_kg_m2=self.inertia_kg_m2,
        )


@dataclass(frozen=True)
class Experiment:
    """Everything that decides a run."""

    seed: int
    scene: SceneConfig
    forces: AbstractForces
    remote: RemoteConfig
    start: StartConfig
    link: LinkConfig
    estimator: dict[str, AbstractEstimator]
    follow: AbstractFollow = field(default_factory=Immediate)

    def __post_init__(self) -> None:
        check_range("seed", self.seed, 0, 2**63 - 1)
        if not self.estimator:
            raise ConfigError("estimator: at least one is needed, such as estimator=linear.")
        if REMOTE in self.estimator:
            raise ConfigError(f"estimator: '{REMOTE}' is the name of the remote cube, choose another.")
        update_steps(self.link, self.scene.timestep_s, 0)
        try:
            _ = self.local  # checks what the start has of the remote
        except ConfigError as error:
            raise ConfigError(with_key("start", str(error))) from None
        self._check_length()
        for name, effect in self.remote.effects.items():
            if effect.of_sensor:
                raise ConfigError(
                    f"remote.effects.{name}: '{effect.name}' changes a measurement after the fact, which a closed "
                    "loop can't do; link.delay_s makes states arrive late."
                )

    def _check_length(self) -> None:
        """Refuse a run whose commands alone would not fit into memory."""
        step_s, steps = self.scene.timestep_s, self.sequence.duration_s / self.scene.timestep_s
        if not steps <= STEPS:
            raise ConfigError(
                f"forces: last {steps * step_s:g} s, {steps:,.0f} steps of {step_s:g} s; a run may have {STEPS:,}."
            )

    @property
    def steps(self) -> int:
        """Number of physics steps."""
        return max(1, round(self.sequence.duration_s / self.scene.timestep_s))

    @property
    def sequence(self) -> AbstractForces:
        """The force sequence, with the run's seed where it wants one."""
        return self.forces.with_seed(self.seed)

    @property
    def local(self) -> BodyConfig:
        """The local cube at the start."""
        return self.start.body(self.remote)


@dataclass(frozen=True)
class Commands:
    """What is commanded, over physics steps: force and point (n, 3), and the pushes of all bodies (n + 1, b * 12).

    The last row of pushes is zero: it is handed over after the last step.
    """

    force_n: np.ndarray
    point_m: np.ndarray
    pushes: np.ndarray


def commands(experiment: Experiment) -> Commands:
    """Return the commands of an experiment. The remote's pass through its effects, the locals' are the nominal ones."""
    h, n = experiment.scene.timestep_s, experiment.steps
    force, point = experiment.sequence.columns(np.arange(n) * h, h)
    pushes = np.zeros((n + 1, 1 + len(experiment.estimator), dry_friction.PUSH_SIZE))
    # most of a sequence is rest: zero already
    pushed = np.flatnonzero(force.any(axis=1))
    nominal = push_columns(force[pushed], point[pushed])
    if experiment.remote.effects:
        real = np.zeros((n, dry_friction.PUSH_SIZE))
        real[pushed] = nominal
        for effect in in_stages(experiment.remote.effects.values()):
            real = effect.edit_command(real, h)
        pushes[:n, 0] = real
    else:
        pushes[pushed, 0] = nominal
    for j in range(1, pushes.shape[1]):
        pushes[pushed, j] = nominal
    return Commands(force, point, pushes.reshape(n + 1, -1))


def warning_text(grown: np.ndarray) -> str:
    """Name the warnings of MuJoCo whose counters have grown, in the order of `mjtWarning`."""
    names = [name for name, g in zip(mujoco.mjtWarning.__members__, grown, strict=False) if g]
    return f"MuJoCo warned of {', '.join(names)}"


class Physics(mjcf.Physics):
    """dm-control's physics, with a `step` that looks for warnings in less time than a physics step takes.

    The step is that of `legacy_step=False`: exactly MuJoCo's `mj_step`, then PhysicsError if it has warned.
    """

    def _reload_from_data(self, data: Any) -> None:
        super()._reload_from_data(data)
        self._raw = self.model.ptr, self.data.ptr
        self._quiet = self._warnings.tobytes()

    def step(self, nstep: int = 1) -> None:
        mujoco.mj_step(*self._raw, nstep)
        if self._warnings.tobytes() != self._quiet:
            grown = self._warnings > np.frombuffer(self._quiet, self._warnings.dtype)
            self._quiet = self._warnings.tobytes()
            # a reset sets the counters to zero, which is no warning
            if grown.any():
                raise PhysicsError(warning_text(grown))


@dataclass(frozen=True)
class CompiledExperiment:
    """An experiment ready to run: physics, the handles of the cubes, the player, and the truth.

    `handles[0]` is the remote's, then one for each estimator, in their order. `truth` has the true and start values of
    what may be estimated.
    """

    physics: mjcf.Physics
    scratch: mujoco.MjData
    handles: tuple[BodyHandle, ...]
    player: player.Player
    truth: Mapping[str, Truth]

    @property
    def model(self) -> mujoco.MjModel:
        """The raw MuJoCo model."""
        return self.physics.model.ptr

    @property
    def data(self) -> mujoco.MjData:
        """The raw MuJoCo data."""
        return self.physics.data.ptr


def compile_experiment(experiment: Experiment) -> CompiledExperiment:
    """Compile an experiment; every call gives a physics of its own."""
    physics = Physics.from_mjcf_model(scene_of(experiment))
    physics.legacy_step = False
    model = physics.model.ptr
    scratch = mujoco.MjData(model)
    set_numbers(experiment, model, scratch)
    return CompiledExperiment(
        physics, scratch, handles_of(experiment, model), player_of(experiment, model), truth_of(experiment, model)
    )


def scene_of(experiment: Experiment) -> mjcf.RootElement:
    """Return the MJCF: the remote, the locals as if their mass were known, what effects add, room for the player."""
    remote = experiment.remote
    local = replace(experiment.local, mass_kg=remote.mass_kg, inertia_kg_m2=None)
    root = build(experiment.scene, {REMOTE: remote.body} | dict.fromkeys(experiment.estimator, local))
    for effect in remote.effects.values():
        effect.edit_mjcf(root, REMOTE)
    player.add(root, bodies=1 + len(experiment.estimator))
    return root


def compile_key(experiment: Experiment) -> str:
    """Return a text that two experiments share if one compiled model serves both, but for `set_numbers`."""
    structural = [(key, effect) for key, effect in experiment.remote.effects.items() if effect.structural]
    remote = replace(experiment.remote, effects=dict(structural))
    local = replace(experiment.local, mass_kg=1.0, inertia_kg_m2=None)
    return repr((experiment.scene, remote, local, tuple(experiment.estimator)))


def set_numbers(experiment: Experiment, model: mujoco.MjModel, scratch: mujoco.MjData) -> None:
    """Write the effects on the remote, and the start values of the locals, into a compiled model that has neither."""
    shared = np.array([*model.opt.gravity, model.opt.density, model.opt.viscosity, *model.opt.wind])
    for key, effect in experiment.remote.effects.items():
        effect.edit_model(Target(model, model.body(REMOTE).id, scratch))
        if not np.array_equal(shared, [*model.opt.gravity, model.opt.density, model.opt.viscosity, *model.opt.wind]):
            raise ConfigError(
                f"remote.effects.{key}: '{effect.name}' changes what all cubes of a scene share, so it can't be "
                "planted in the remote alone."
            )
    set_start(experiment, model, scratch)


def set_start(experiment: Experiment, model: mujoco.MjModel, scratch: mujoco.MjData) -> None:
    """Write the start values of the locals."""
    body = experiment.local
    for name in experiment.estimator:
        index = model.body(name).id
        model.body_mass[index] = body.mass_kg
        model.body_inertia[index] = np.asarray(body.inertia) / body.mass_kg * body.mass_kg
        model.body_ipos[index] = body.com_m
        model.body_user[index, dry_friction.COLUMN["mu"]] = body.friction
    mujoco.mj_setConst(model, scratch)


def handles_of(experiment: Experiment, model: mujoco.MjModel) -> tuple[BodyHandle, ...]:
    """Return the handles of the remote and of the locals, in the order of the estimators."""
    names = [REMOTE, *experiment.estimator]
    found = handles(model, names)
    return tuple(found[name] for name in names)


def player_of(experiment: Experiment, model: mujoco.MjModel) -> player.Player:
    """Return the player that `scene_of` made room for."""
    return player.Player(1 + len(experiment.estimator), model.nq, model.nv)


def truth_of(experiment: Experiment, model: mujoco.MjModel) -> dict[str, Truth]:
    """Return true (at the start, with effects) and start values of what estimators may estimate, by name."""
    return truths(model, model.body(REMOTE).id, experiment.local)
