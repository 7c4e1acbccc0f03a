"""A compound object, and one box in its place: ten inertial parameters in 3-D from pushes at any height.

The remote is made of several boxes of different density; MuJoCo composes its mass, centre of mass and inertia. The
local model is one box of the same outer size with free inertial parameters. In each episode the object hangs from a
point, is held upright, let go and pushed at the same time. All are simulated from rest by `mujoco.rollout` and compared
with the measured motion (output error), least squares by scipy's trust region.

Why hanging. On four corners a push that slides the object makes its leading edge chatter: measured, a change of the
mass by 1e-5 changes the velocity half a second later by up to 1e4 times as much, in either direction, so that no
gradient says anything. Tipping over an edge is smooth until the object falls back. Hanging, all ten parameters show in
a motion without contact. Pushes on the floor at any height, sliding, turning and tipping, are the test instead: what
the fitted box does under them beside what the object does.

The parameters are those of the pseudo-inertia matrix (Wensing, Kim and Slotine 2018)

    J = [ S  h ]     S = integral of x x^T dm = tr(I) / 2 - I about the body frame,   h = m c
        [ h' m ]

which is positive definite for every body that has mass anywhere in 3-D, and for no other numbers. With J = L L^T, L
lower triangular with a positive diagonal, the logarithms of the diagonal and the other six entries are ten free numbers
(log-Cholesky, Rucker and Wensing 2022): whatever the search tries is a possible body.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import scipy
from dm_control import mjcf
from mujoco import rollout

from runner.config import registered
from runner.errors import ConfigError, check_range, check_vector
from runner.physics.forces import Push, push_means
from runner.physics.scene import BodyConfig, Contact, Dof, SceneConfig, build, push_columns
from runner.progress import track
from runner.studies.base import AbstractStudy, Rows
from runner.studies.plumb_line import LIFT_M, log_estimate
from runner.systems.planar_box.simulator import FULL, USERDATA
from runner.teleop.experiment import REMOTE, Experiment
from runner.teleop.link import NoiseConfig
from runner.viewer.rrd import written

Vector = tuple[float, float, float]
NAMES = (
    "mass_kg", "com_x_m", "com_y_m", "com_z_m", "inertia_xx_kg_m2", "inertia_yy_kg_m2", "inertia_zz_kg_m2",
    "inertia_xy_kg_m2", "inertia_xz_kg_m2", "inertia_yz_kg_m2",
)  # fmt: skip
SIZE = len(NAMES)
_OFF = ([0, 0, 1], [1, 2, 2])  # xy, xz, yz
_LOWER = np.tril_indices(4, -1)
_STEP = 1e-5  # for differences, of numbers of order one
PRIOR_SD = 1.0  # of each free number: how far the truth may be from what is believed
_TRIED = 2.0 ** np.arange(-2.0, 2.1, 0.5)  # masses to begin with, in those of the start


class Inertial(NamedTuple):
    """Mass, kg, centre of mass (3,), m, body axes, and inertia about it, (3, 3), kg m2, body axes."""

    mass_kg: float
    com_m: np.ndarray
    inertia_kg_m2: np.ndarray

    @property
    def values(self) -> np.ndarray:
        """In the order of `NAMES`, (10,)."""
        inertia = self.inertia_kg_m2
        return np.concatenate([[self.mass_kg], self.com_m, np.diag(inertia), inertia[_OFF]])


def pseudo_inertia(body: Inertial) -> np.ndarray:
    """Return the pseudo-inertia matrix about the body frame, (4, 4)."""
    m, c = body.mass_kg, body.com_m
    out = np.empty((4, 4))
    out[:3, :3] = 0.5 * np.trace(body.inertia_kg_m2) * np.eye(3) - body.inertia_kg_m2 + m * np.outer(c, c)
    out[:3, 3] = out[3, :3] = m * c
    out[3, 3] = m
    return out


def to_vector(body: Inertial, half_size_m: np.ndarray) -> np.ndarray:
    """Return the ten free numbers of a body, (10,), lengths in half sizes.

    Raises:
        numpy.linalg.LinAlgError: If no distribution of mass has these parameters.
    """
    scale = np.append(1.0 / half_size_m, 1.0)
    # mass first, so that its logarithm is one of the numbers
    lower = np.linalg.cholesky((scale[:, None] * pseudo_inertia(body) * scale)[::-1, ::-1])
    ratio = lower / np.diag(lower)  # columns in units of their diagonal: all of order one
    return np.concatenate([np.log(np.diag(lower)), ratio[_LOWER]])


def from_vector(x: np.ndarray, half_size_m: np.ndarray) -> Inertial:
    """Return the body of ten free numbers; whatever they are, it can exist."""
    lower = np.eye(4)
    lower[_LOWER] = x[4:]
    lower = lower * np.exp(x[:4])
    scale = np.append(half_size_m, 1.0)
    matrix = scale[:, None] * (lower @ lower.T)[::-1, ::-1] * scale
    mass = float(matrix[3, 3])
    com = matrix[:3, 3] / mass
    second = matrix[:3, :3] - mass * np.outer(com, com)
    return Inertial(mass, com, np.trace(second) * np.eye(3) - second)


def inertial_in(model: mujoco.MjModel, body_id: int) -> Inertial:
    """Return what a compiled model says of a body."""
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body_id])
    axes = turn.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[body_id]) @ axes.T
    return Inertial(float(model.body_mass[body_id]), model.body_ipos[body_id].copy(), inertia)


def write_inertial(model: mujoco.MjModel, scratch: mujoco.MjData, body_id: int, body: Inertial) -> None:
    """Write mass, centre of mass and inertia into a compiled model."""
    moments, axes = np.linalg.eigh(body.inertia_kg_m2)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    model.body_mass[body_id], model.body_ipos[body_id] = body.mass_kg, body.com_m
    model.body_inertia[body_id] = moments
    mujoco.mju_mat2Quat(model.body_iquat[body_id], np.ascontiguousarray(axes).ravel())
    mujoco.mj_setConst(model, scratch)


@dataclass(frozen=True)
class Part:
    """A box of the compound object: its half size, its centre in the object's frame, its density."""

    half_size_m: Vector
    centre_m: Vector
    density_kg_m3: float

    def __post_init__(self) -> None:
        check_vector("half_size_m", self.half_size_m, 3, unit="m", limit=100.0)
        for i, half in enumerate(self.half_size_m):
            check_range(f"half_size_m[{i}]", half, 0.0, 100.0, unit="m", lower_open=True)
        check_vector("centre_m", self.centre_m, 3, unit="m", limit=100.0)
        check_range("density_kg_m3", self.density_kg_m3, 0.0, 1e5, unit="kg/m3", lower_open=True)


@dataclass(frozen=True)
class Poke:
    """A push from rest: a force, world axes, at a point, body axes, for a time; hung from a point, None: standing."""

    force_n: Vector
    point_m: Vector
    push_s: float = 0.4
    hung_m: Vector | None = None

    def __post_init__(self) -> None:
        check_vector("force_n", self.force_n, 3, unit="N", limit=1e6)
        check_vector("point_m", self.point_m, 3, unit="m", limit=100.0)
        check_range("push_s", self.push_s, 1e-3, 100.0, unit="s")


def compound_mjcf(scene: SceneConfig, friction: float, half_size_m: Vector, parts: Sequence[Part]) -> mjcf.RootElement:
    """Return the MJCF of the compound object; MuJoCo makes its mass, centre and inertia of the geoms."""
    shell = BodyConfig(mass_kg=1.0, friction=friction, half_size_m=half_size_m)
    root = build(scene, {REMOTE: shell})
    body = root.find("body", REMOTE)
    body.inertial.remove()
    for geom in body.find_all("geom"):
        geom.mass = 0.0
    for i, part in enumerate(parts):
        body.add(
            "geom", name=f"part{i}", type="box", size=part.half_size_m, pos=part.centre_m, density=part.density_kg_m3,
            contype=0, conaffinity=0,
        )  # fmt: skip
    return root


class Episodes:
    """Pushes from rest, simulated for any bodies, sampled at the update rate.

    Args:
        scene: Free, on corners or feet.
        root: Of a model with one body, whose inertial parameters are replaced; changed.
        pokes: One for each episode; all hung, or all standing.
        duration_s: Of each; the push begins after `lead_s`.
        rate_hz: Of the samples.
    """

    def __init__(
        self, scene: SceneConfig, root: mjcf.RootElement, pokes: Sequence[Poke], *, duration_s: float, lead_s: float,
        rate_hz: float,
    ) -> None:  # fmt: skip
        if pokes[0].hung_m is not None:
            root.find("body", REMOTE).pos = (0.0, 0.0, LIFT_M)
        for i, poke in enumerate(pokes):
            if poke.hung_m is not None:
                root.equality.add("connect", name=f"point{i}", body1=REMOTE, anchor=poke.hung_m, active="false")
        self.model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
        self.body_id = self.model.body(REMOTE).id
        self._data, self._scratch = mujoco.MjData(self.model), mujoco.MjData(self.model)
        self._every = round(1 / rate_hz / scene.timestep_s)
        steps = round(duration_s * rate_hz) * self._every
        times = np.arange(steps) * scene.timestep_s
        self.control = np.zeros((len(pokes), steps, self.model.nuserdata))
        for row, poke in zip(self.control, pokes, strict=True):
            force, point = push_means(
                [Push(lead_s, lead_s + poke.push_s, poke.force_n, poke.point_m)], times, scene.timestep_s
            )
            columns = push_columns(force, point)
            row[:, : columns.shape[1]] = columns
        self.simulated_s = 0.0

    def run(self, bodies: Sequence[Inertial]) -> np.ndarray:
        """Return positions (x, y, z, quaternion) and velocities of all episodes, (len(bodies), episodes, n, 13)."""
        models = []
        episodes, steps, _ = self.control.shape
        for body in bodies:
            model = copy.copy(self.model)
            write_inertial(model, self._scratch, self.body_id, body)
            for k in range(episodes):
                one = copy.copy(model) if model.neq else model
                one.eq_active0[k : k + 1] = True
                models.append(one)
        start = np.empty(mujoco.mj_stateSize(self.model, FULL))
        mujoco.mj_resetData(self.model, self._data)
        mujoco.mj_getState(self.model, self._data, start, FULL)
        states, _ = rollout.rollout(
            models,
            self._data,
            np.tile(start, (len(models), 1)),
            np.tile(self.control, (len(bodies), 1, 1)),
            control_spec=USERDATA,
        )
        self.simulated_s += len(models) * steps * self.model.opt.timestep
        sampled = states[:, self._every - 1 :: self._every, 1:14]
        return sampled.reshape(len(bodies), episodes, -1, 13)


def differences(motion: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return motion less measurement, (..., 12): position, turning (body axes), velocity, angular velocity."""
    turn = _rotation(np.broadcast_to(measured, motion.shape)).inv() * _rotation(motion)
    angle = turn.as_rotvec().reshape(*motion.shape[:-1], 3)
    moved, faster = motion[..., :3] - measured[..., :3], motion[..., 7:] - measured[..., 7:]
    return np.concatenate([moved, angle, faster], axis=-1)


def _rotation(motion: np.ndarray) -> scipy.spatial.transform.Rotation:
    return scipy.spatial.transform.Rotation.from_quat(motion[..., 3:7].reshape(-1, 4), scalar_first=True)


def with_noise(motion: np.ndarray, noise: NoiseConfig, rng: np.random.Generator) -> np.ndarray:
    """Return measurements of motions (..., 13) with noise."""
    draw = noise.draws(motion[..., 0].size, 3, 3, rng).reshape(*motion.shape[:-1], 12)
    out = motion.copy()
    out[..., :3] += draw[..., :3]
    turned = _rotation(motion) * scipy.spatial.transform.Rotation.from_rotvec(draw[..., 3:6].reshape(-1, 3))
    out[..., 3:7] = turned.as_quat(scalar_first=True).reshape(*motion.shape[:-1], 4)
    out[..., 7:] += draw[..., 6:]
    return out


class Fit(NamedTuple):
    """A fitted body, the covariance of its values in the order of `NAMES`, (10, 10), and the loss per number."""

    body: Inertial
    covariance: np.ndarray
    loss: float


def fit(episodes: Episodes, measured: np.ndarray, noise: NoiseConfig, start: Inertial, half_size_m: np.ndarray) -> Fit:
    """Fit the inertial parameters of one body to measured episodes.

    Args:
        episodes: The local model.
        measured: (episodes, n, 13).
        noise: To weigh the measurements with; must not be zero.
        start: What is believed; other masses of the same shape are tried as well.
        half_size_m: Of the body, (3,).
    """
    sd = np.repeat([noise.position_m, noise.angle_rad, noise.velocity_m_s, noise.rate_rad_s], 3)

    def residuals(vectors: np.ndarray, upto: int) -> np.ndarray:
        motion = episodes.run([from_vector(x, half_size_m) for x in vectors])
        found = differences(motion[:, :, :upto], measured[:, :upto]) / sd
        return np.hstack([found.reshape(len(vectors), -1), (vectors - believed) / PRIOR_SD])

    believed = to_vector(start, half_size_m)

    samples = measured.shape[1]
    bodies = [Inertial(f * start.mass_kg, start.com_m, f * start.inertia_kg_m2) for f in _TRIED]
    tried = np.array([to_vector(body, half_size_m) for body in bodies])
    # a robust loss, as far-off motions say little
    x = tried[np.log1p(residuals(tried, samples // 2) ** 2).sum(axis=1).argmin()]
    result: Any = None
    # far-off motions count less on the way; at the end it is least squares
    for upto, loss in ((samples // 3, "soft_l1"), (samples, "soft_l1"), (samples, "linear")):

        def derivative(at: np.ndarray, upto: int = upto) -> np.ndarray:
            both = residuals(np.concatenate([at + _STEP * np.eye(SIZE), at - _STEP * np.eye(SIZE)]), upto)
            return ((both[:SIZE] - both[SIZE:]) / (2 * _STEP)).T

        def value(at: np.ndarray, upto: int = upto) -> np.ndarray:
            return residuals(at[None], upto)[0]

        jac: Any = derivative  # a function, which the stubs of scipy do not know of
        result = scipy.optimize.least_squares(value, x, jac, x_scale="jac", loss=loss, max_nfev=40, ftol=1e-8)
        x = result.x
    spread = np.linalg.inv(result.jac.T @ result.jac)
    change = np.stack(
        [
            (from_vector(x + _STEP * e, half_size_m).values - from_vector(x - _STEP * e, half_size_m).values)
            / 2
            / _STEP
            for e in np.eye(SIZE)
        ],
        axis=1,
    )
    return Fit(from_vector(x, half_size_m), change @ spread @ change.T, 2 * result.cost / result.fun.size)


HUNG = tuple(
    Poke(force, point, hung_m=hung)
    for hung, points in (
        ((0.5, 0.0, 0.0), ((0.0, 0.5, 0.0), (-0.5, 0.0, 0.0), (0.0, -0.5, 0.0))),
        ((0.0, 0.5, 0.0), ((0.0, 0.0, -0.5), (0.5, 0.0, 0.0), (-0.5, 0.0, 0.0))),
        ((0.0, 0.0, 0.5), ((0.0, 0.5, 0.0), (0.0, 0.0, -0.5), (0.5, 0.0, 0.0))),
    )
    for force, point in zip(((6.0, 0.0, 0.0), (0.0, 6.0, 0.0), (0.0, 0.0, 6.0)), points, strict=True)
)
# to test with, on the floor: at the height of the base and above, at an edge, at a corner
STANDING = {
    "low": Poke((35.0, 0.0, 0.0), (-0.5, 0.1, -0.45)),
    "middle": Poke((36.0, 0.0, 0.0), (-0.5, 0.0, 0.0)),
    "top": Poke((27.0, 0.0, 0.0), (-0.5, 0.0, 0.5)),
    "top, aside": Poke((0.0, 26.0, 0.0), (-0.3, -0.5, 0.5)),
    "top corner": Poke((-20.0, 20.0, 0.0), (0.5, -0.5, 0.5)),
}


@registered("study")
@dataclass(frozen=True)
class Compound(AbstractStudy):
    """Fit one box to a compound object, without noise and with, and test it with pushes on the floor.

    Attributes:
        parts: What the object is made of; all must lie within the remote's `half_size_m`.
        seeds: Fits with noise.
        duration_s: Of an episode.
    """

    parts: dict[str, Part]
    seeds: int = 3
    duration_s: float = 1.0

    def __post_init__(self) -> None:
        if not self.parts:
            raise ConfigError("parts: at least one is needed.")
        check_range("seeds", self.seeds, 0, 10_000)
        check_range("duration_s", self.duration_s, 0.1, 100.0, unit="s")

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        scene = replace(experiment.scene, dof=Dof.free, contact=Contact.corners)
        half = np.array(experiment.remote.half_size_m)
        for name, part in self.parts.items():
            if (np.abs(part.centre_m) + part.half_size_m > half * (1 + 1e-9)).any():
                raise ConfigError(f"study.parts.{name}: reaches out of the object, whose half size is {half} m.")
        friction = experiment.remote.friction
        box = BodyConfig(experiment.start.mass_kg, friction, experiment.remote.half_size_m)

        def episodes(root: mjcf.RootElement, pokes: Sequence[Poke]) -> Episodes:
            return Episodes(scene, root, pokes, duration_s=self.duration_s, lead_s=0.0, rate_hz=experiment.link.rate_hz)

        def compound() -> mjcf.RootElement:
            return compound_mjcf(scene, friction, experiment.remote.half_size_m, list(self.parts.values()))

        remote = episodes(compound(), HUNG)
        true = inertial_in(remote.model, remote.body_id)
        local = episodes(build(scene, {REMOTE: box}), HUNG)
        start = Inertial(box.mass_kg, np.array(experiment.start.com_m or (0.0, 0.0, 0.0)), np.diag(box.inertia))
        motion = remote.run([true])[0]
        noise = experiment.link.noise or NOISE
        out: Rows = []
        for seed in track(range(self.seeds + 1), "Fitting", unit="fits"):
            measured = motion
            if seed:
                measured = with_noise(motion, noise, np.random.default_rng([experiment.seed, seed]))
            found = fit(local, measured, noise, start, half)
            out += _parameter_rows(seed, true, start, found, half)
            if seed == min(1, self.seeds):
                write_rrd(
                    folder / "run.rrd", list(self.parts.values()), half, motion, experiment.link.rate_hz, true, found
                )
            if seed in (0, 1):
                standing = episodes(build(scene, {REMOTE: box}), list(STANDING.values()))
                truth = episodes(compound(), list(STANDING.values())).run([true])[0]
                out += _test_rows(seed, truth, standing.run([start, found.body]))
        return out


def write_rrd(
    file: Path,
    parts: Sequence[Part],
    half_size_m: np.ndarray,
    motion: np.ndarray,
    rate_hz: float,
    true: Inertial,
    found: Fit,
) -> None:
    """Write for the Rerun viewer how the object moved, all episodes one after the other, and its CoM as fitted."""
    view = rrb.Spatial3DView(origin="/world", name="hanging in turn; blue: true centre of mass, white: fitted")
    layout = rrb.Blueprint(view, rrb.TimePanel(state="collapsed", timeline="sim_time"), auto_views=False)
    states = motion.reshape(-1, motion.shape[-1])
    time_s = np.arange(1, len(states) + 1) / rate_hz
    with written(file, layout) as recording:
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        boxes = rr.Boxes3D(
            half_sizes=[part.half_size_m for part in parts],
            centers=[part.centre_m for part in parts],
            colors=[(240, 140, 40)],
            radii=0.004,
        )
        recording.log("world/object/parts", boxes, static=True)
        hull = rr.Boxes3D(half_sizes=[half_size_m], colors=[(150, 150, 150)], radii=0.002)
        recording.log("world/object/hull", hull, static=True)
        recording.log("world/object/true", rr.Points3D([true.com_m], colors=[(70, 130, 220)], radii=0.015), static=True)
        log_estimate(recording, "world/object/estimate", found.body.com_m, found.covariance[1:4, 1:4])
        recording.send_columns(
            "world/object",
            [rr.TimeColumn("sim_time", duration=np.round(1e9 * time_s).astype("timedelta64[ns]"))],
            rr.Transform3D.columns(translation=states[:, :3], quaternion=states[:, [4, 5, 6, 3]]),
        )


NOISE = NoiseConfig(position_m=5e-4, angle_rad=1e-3, velocity_m_s=5e-3, rate_rad_s=1e-2)


def _parameter_rows(seed: int, true: Inertial, start: Inertial, found: Fit, half_size_m: np.ndarray) -> Rows:
    size = np.trace(true.inertia_kg_m2) / 3
    scale = np.concatenate([[true.mass_kg], half_size_m, np.full(6, size)])
    error = found.body.values - true.values
    squared = float(error @ np.linalg.solve(found.covariance, error))
    table = zip(
        NAMES, true.values, start.values, found.body.values, found.covariance.diagonal() ** 0.5, scale, strict=True
    )
    return [
        {
            "noise": bool(seed),
            "seed": seed,
            "parameter": name,
            "true": float(truth),
            "start": float(begin),
            "estimate": float(value),
            "se": float(se) if seed else float("nan"),
            "error": float((value - truth) / unit),
            "mahalanobis2": squared if seed else float("nan"),
        }
        for name, truth, begin, value, se, unit in table
    ]


def _test_rows(seed: int, truth: np.ndarray, both: np.ndarray) -> Rows:
    """Return how far the believed box and the fitted box are from the object, under pushes on the floor."""
    up = 1 - 2 * (truth[..., 4] ** 2 + truth[..., 5] ** 2)
    tilt = np.degrees(np.arccos(np.clip(up, -1, 1))).max(axis=1)
    behind = np.linalg.norm(both[..., :3] - truth[..., :3], axis=-1).max(axis=-1)
    turned = np.degrees(np.linalg.norm(differences(both, truth)[..., 3:6], axis=-1)).max(axis=-1)
    return [
        {
            "noise": bool(seed),
            "seed": seed,
            "test": name,
            "moved_m": float(np.linalg.norm(truth[k, -1, :2] - truth[k, 0, :2])),
            "tilt_deg": float(tilt[k]),
            "start_off_m": float(behind[0, k]),
            "fitted_off_m": float(behind[1, k]),
            "start_off_deg": float(turned[0, k]),
            "fitted_off_deg": float(turned[1, k]),
        }
        for k, name in enumerate(STANDING)
    ]
