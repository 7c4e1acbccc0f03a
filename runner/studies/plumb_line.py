"""The plumb line: a body that hangs at rest has its centre of mass under the point it hangs from.

Hung from two or three points in turn, each gives a line through the body; the centre of mass is where they cross. The
body swings on MuJoCo's `connect` constraint, in free motion above the floor, until it is at rest. Its orientation is
then measured for a while.

The crossing is the point of least weighted squared distance from the lines. A direction that is wrong by an angle
misses the centre by that angle times its distance r from the hanging point, so a line counts by 1 / r^2, r from the
unweighted crossing. The covariance follows, (sum_i (I - d_i d_i^T) / (sigma r_i)^2)^-1, with sigma the standard
deviation of a mean direction. Two points on one line through the centre of mass give one line, and no crossing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import mujoco
import numpy as np

from runner.config import registered
from runner.effects.planar_box import Target
from runner.errors import ConfigError, ResultError, check_range, check_vector
from runner.physics.scene import Dof, FloorContact, build, rotate
from runner.progress import track
from runner.studies.base import AbstractStudy, Rows
from runner.teleop.experiment import REMOTE, Experiment

if TYPE_CHECKING:
    import rerun as rr

LIFT_M = 10.0  # so high that nothing touches the floor
AT_REST_RAD_S = 1e-6
CROSSING = 1e-3  # least eigenvalue of the lines' normal matrix, per line: below it they are one line


class Crossing(NamedTuple):
    """Where lines cross: the point (3,), m, and its covariance for directions of this uncertainty, (3, 3), m2."""

    point_m: np.ndarray
    covariance_m2: np.ndarray


def crossing(points_m: np.ndarray, directions: np.ndarray, sigma_rad: float) -> Crossing:
    """Return where lines cross best.

    Args:
        points_m: A point on each, (k, 3).
        directions: Unit vectors along them, (k, 3).
        sigma_rad: Standard deviation of each direction, about each axis across it.

    Raises:
        ResultError: If they are parallel, or but one.
    """
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    if len(points_m) < 2 or np.linalg.eigvalsh(across.mean(axis=0))[0] < CROSSING:
        raise ResultError("points_m: the lines do not cross; hang the body from points that are not on one line.")

    def solve(weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        normal = np.einsum("k,kij->ij", weight, across)
        return np.linalg.solve(normal, np.einsum("k,kij,kj->i", weight, across, points_m)), normal

    rough, _ = solve(np.ones(len(points_m)))
    # a hanging point at the centre of mass itself would count without bound
    distance = np.maximum(np.linalg.norm(points_m - rough, axis=1), 1e-3 * np.linalg.norm(np.ptp(points_m, axis=0)))
    point, normal = solve(distance**-2)
    return Crossing(point, sigma_rad**2 * np.linalg.inv(normal))


class Swing(NamedTuple):
    """A body that came to rest: times (n,), s, orientations on the way (n, 4), w first, and the last one (4,)."""

    time_s: np.ndarray
    quaternion: np.ndarray
    at_rest: np.ndarray


@dataclass(frozen=True)
class Hanging:
    """A body that can be hung from some points; `com_m` is its true centre of mass, (3,), body axes."""

    model: mujoco.MjModel
    body_id: int
    com_m: np.ndarray

    def swing(self, point: int, *, damping_nms_rad: float, longest_s: float) -> Swing:
        """Hang the body from one of its points and let it swing until it has been at rest for a second.

        Raises:
            ResultError: If it takes longer than `longest_s`.
        """
        model, data = self.model, mujoco.MjData(self.model)
        data.eq_active[:] = False
        data.eq_active[point] = True
        dof = int(model.body_dofadr[self.body_id])
        model.dof_damping[dof + 3 : dof + 6] = damping_nms_rad
        quaternion = data.qpos[3:7]
        often, calm = max(1, round(0.02 / model.opt.timestep)), 0
        times, path = [], []
        while data.time < longest_s:
            mujoco.mj_step(model, data, often)
            times.append(data.time)
            path.append(quaternion.copy())
            calm = calm + 1 if np.abs(data.qvel[3:6]).max() < AT_REST_RAD_S else 0
            if calm * often * model.opt.timestep >= 1.0:
                return Swing(np.array(times), np.array(path), quaternion.copy())
        raise ResultError(f"longest_s: the body still swings after {longest_s:g} s; choose another damping_nms_rad.")


def hang(experiment: Experiment, points_m: Sequence[Sequence[float]]) -> Hanging:
    """Return the remote of an experiment, effects included, so that it can be hung from these points, body axes."""
    scene = replace(experiment.scene, dof=Dof.free, contact=FloorContact.corners)
    root = build(scene, {REMOTE: experiment.remote.body})
    body = root.find("body", REMOTE)
    body.pos = (0.0, 0.0, LIFT_M)
    for i, point in enumerate(points_m):
        root.equality.add("connect", name=f"point{i}", body1=REMOTE, anchor=point, active="false")
    for effect in experiment.remote.effects.values():
        effect.edit_mjcf(root, REMOTE)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
    body_id = model.body(REMOTE).id
    for effect in experiment.remote.effects.values():
        effect.edit_model(Target(model, body_id, mujoco.MjData(model)))
    return Hanging(model, body_id, model.body_ipos[body_id].copy())


def plumb(quaternion: np.ndarray) -> np.ndarray:
    """Return which way is down in body axes, (..., 3), from orientations (..., 4), w first."""
    inverse = quaternion * np.array([1.0, -1.0, -1.0, -1.0])
    return rotate(inverse, np.broadcast_to([0.0, 0.0, -1.0], (*quaternion.shape[:-1], 3)))


def measured_plumb(quaternion: np.ndarray, sigma_rad: float, samples: int, rng: np.random.Generator) -> np.ndarray:
    """Return the mean measured direction of down, (3,), from an orientation that is measured some times with noise."""
    noisy = np.repeat(quaternion[None], samples, axis=0)
    for one, turn in zip(noisy, sigma_rad * rng.standard_normal((samples, 3)), strict=True):
        mujoco.mju_quatIntegrate(one, turn, 1.0)
    mean = plumb(noisy).mean(axis=0)
    return mean / np.linalg.norm(mean)


@registered("study")
@dataclass(frozen=True)
class PlumbLine(AbstractStudy):
    """The centre of mass of the remote, and of others like it with their centre elsewhere, by plumb line.

    Attributes:
        points_m: Where to hang the body from, body axes; a row for the first two, for the first three, and so on.
        objects: Bodies; the first is the remote itself, the others have a random centre of mass.
        spread: Of random centres, as share of the half size to either side.
        damping_nms_rad: Of the turning at the hanging point.
        measure_s: How long the orientation is measured at rest, at the link's rate, with its noise of angles.
        longest_s: Until which a body must have come to rest.
    """

    points_m: tuple[list[float], ...] = ([0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5])
    objects: int = 20
    spread: float = 0.3
    damping_nms_rad: float = 5.0
    measure_s: float = 1.0
    longest_s: float = 300.0

    def __post_init__(self) -> None:
        if len(self.points_m) < 2:
            raise ConfigError("points_m: at least two points are needed.")
        for i, point in enumerate(self.points_m):
            check_vector(f"points_m[{i}]", tuple(point), 3, unit="m", limit=100.0)
        check_range("objects", self.objects, 1, 10_000)
        check_range("spread", self.spread, 0.0, 0.9)
        check_range("damping_nms_rad", self.damping_nms_rad, 0.0, 1e4, unit="N m s/rad", lower_open=True)
        check_range("measure_s", self.measure_s, 0.0, 1e3, unit="s")
        check_range("longest_s", self.longest_s, 1.0, 1e5, unit="s")

    def rows(self, experiment: Experiment, folder: Path) -> Rows:
        half = np.array(experiment.remote.half_size_m)
        for i, point in enumerate(self.points_m):
            if (np.abs(point) > half).any():
                raise ConfigError(f"study.points_m[{i}]: {point} m lies outside the body, whose half size is {half} m.")
        out: Rows = []
        for i in track(range(self.objects), "Hanging", unit="objects"):
            rng = np.random.default_rng([experiment.seed, i])
            remote = experiment.remote
            if i:
                com = rng.uniform(-self.spread, self.spread, 3) * half
                remote = replace(remote, com_m=(float(com[0]), float(com[1]), float(com[2])))
            out += self._object(replace(experiment, remote=remote), i, folder, rng)
        return out

    def _object(self, experiment: Experiment, number: int, folder: Path, rng: np.random.Generator) -> Rows:
        hanging = hang(experiment, self.points_m)
        swings = [
            hanging.swing(k, damping_nms_rad=self.damping_nms_rad, longest_s=self.longest_s)
            for k in range(len(self.points_m))
        ]
        points, angle_rad = np.array(self.points_m), experiment.link.noise.angle_rad
        samples = max(1, round(self.measure_s * experiment.link.rate_hz))
        exact = np.array([plumb(s.at_rest) for s in swings])
        noisy = np.array([measured_plumb(s.at_rest, angle_rad, samples, rng) for s in swings])
        out: Rows = []
        for count in range(2, len(points) + 1):
            settled = crossing(points[:count], exact[:count], 1.0)
            found = crossing(points[:count], noisy[:count], angle_rad / math.sqrt(samples))
            row: dict[str, float] = {}
            for axis, true, value, variance in zip(
                "xyz", hanging.com_m, found.point_m, np.diag(found.covariance_m2), strict=True
            ):
                row |= {f"com_{axis}_true_m": true, f"com_{axis}_m": value, f"com_{axis}_se_m": math.sqrt(variance)}
            error = found.point_m - hanging.com_m
            row["error_mm"] = 1e3 * float(np.linalg.norm(error))
            row["error_without_noise_mm"] = 1e3 * float(np.linalg.norm(settled.point_m - hanging.com_m))
            if angle_rad > 0:
                row["mahalanobis2"] = float(error @ np.linalg.solve(found.covariance_m2, error))
            row["swinging_s"] = float(sum(s.time_s[-1] for s in swings[:count]))
            out.append({"object": number, "points": count} | {key: float(value) for key, value in row.items()})
            if number == 0 and count == len(points):
                write_rrd(folder / "run.rrd", experiment, hanging, points, swings, noisy, found)
        return out


def write_rrd(
    file: Path,
    experiment: Experiment,
    hanging: Hanging,
    points_m: np.ndarray,
    swings: Sequence[Swing],
    directions: np.ndarray,
    found: Crossing,
) -> None:
    """Write what was seen for the Rerun viewer: the body on each of its points, the lines in it, and their crossing."""
    import rerun as rr  # which no other run should wait for
    import rerun.blueprint as rrb

    from runner.viewer.rrd import written

    half = np.array(experiment.remote.half_size_m)
    reach = 2.2 * float(np.linalg.norm(half))
    colours = [(240, 140, 40), (60, 190, 130), (200, 90, 200), (220, 200, 60)]
    view = rrb.Spatial3DView(origin="/world", name="hanging in turn; lines: down at rest; blue: true, white: estimated")
    layout = rrb.Blueprint(view, rrb.TimePanel(state="collapsed", timeline="sim_time"), auto_views=False)
    with written(file, layout) as recording:
        recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        recording.log("world/body", rr.Boxes3D(half_sizes=[half], colors=[(70, 130, 220)], radii=0.006), static=True)
        recording.log("world/body/true", rr.Points3D([hanging.com_m], colors=[(70, 130, 220)], radii=0.02), static=True)
        log_estimate(recording, "world/body/estimate", found.point_m, found.covariance_m2)
        begin = 0.0
        for k, (point, swing, down) in enumerate(zip(points_m, swings, directions, strict=True)):
            time_s = begin + swing.time_s
            index = [rr.TimeColumn("sim_time", duration=np.round(1e9 * time_s).astype("timedelta64[ns]"))]
            # hung from the world's origin
            place = -rotate(swing.quaternion, np.broadcast_to(point, (len(time_s), 3)))
            recording.send_columns(
                "world/body",
                index,
                rr.Transform3D.columns(translation=place, quaternion=swing.quaternion[:, [1, 2, 3, 0]]),
            )
            recording.set_time("sim_time", duration=float(time_s[-1]))
            strip = [point, point + 1.6 * float(np.linalg.norm(half)) * down]
            recording.log(f"world/body/line{k}", rr.LineStrips3D([strip], colors=[colours[k % 4]], radii=0.006))
            begin = float(time_s[-1])
        recording.log("world/string", rr.LineStrips3D([[(0, 0, 0), (0, 0, 0.4 * reach)]], radii=0.006), static=True)


def log_estimate(recording: rr.RecordingStream, entity: str, point_m: np.ndarray, covariance_m2: np.ndarray) -> None:
    """Draw a point and its ellipsoid of three standard deviations, which is drawn large enough to be seen."""
    import rerun as rr

    variances, axes = np.linalg.eigh(covariance_m2)
    if np.linalg.det(axes) < 0:
        axes[:, 0] *= -1
    ellipsoid = rr.Ellipsoids3D(
        centers=[point_m],
        half_sizes=[np.maximum(3 * np.sqrt(np.maximum(variances, 0.0)), 0.005)],
        quaternions=[_quaternion(axes)],
        colors=[(255, 255, 255)],
    )
    recording.log(entity, ellipsoid, static=True)


def _quaternion(axes: np.ndarray) -> np.ndarray:
    """Return a rotation matrix's quaternion, w last."""
    out = np.empty(4)
    mujoco.mju_mat2Quat(out, np.ascontiguousarray(axes).ravel())
    return out[[1, 2, 3, 0]]
