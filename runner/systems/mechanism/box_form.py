"""From a recording of a box in space to a mechanism of one free body.

Velocities count where their noise is stated. Cameras tell poses; velocities in their logs are as a rule differences of
those, smoothed and late: taken for measurements they would count the same noise twice, and hold a model to what
smoothing makes of an impact.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from runner.errors import RecordingError
from runner.numerics.arrays import FloatArray
from runner.recording import Episode, Recording
from runner.recording.model_form import MechanismEpisode, MechanismRecording, with_episode_to_check
from runner.recording.model_form_mapping import ChannelSource, ForceColumns, ModelMapping, OrientationColumns
from runner.systems.mechanism.box_model import BODY, FILE, mjcf
from runner.systems.mechanism.system import MechanismSystem

QUAT, AXES = "quat", "xyz"
FORCE, POINT = ("fx", "fy", "fz"), ("px", "py", "pz")


@dataclass(frozen=True, eq=False)
class FreeBoxRecording(MechanismRecording):
    """A recording of a box in space; its MJCF is made from what its owner states, `xml`."""

    xml: str = ""

    def spec(self) -> mujoco.MjSpec:
        """Return the MJCF, read anew: it may be edited."""
        return mujoco.MjSpec.from_string(self.xml)


def free_box(recording: Recording) -> MechanismSystem:
    """Return the system of a recording in space.

    Raises:
        RecordingError: If a pose is never measured, or a force is measured at some samples and not at others.
    """
    noise = recording.nominal.noise
    stated = (noise.velocity_m_s is not None, noise.rate_rad_s is not None)
    twist = np.concatenate([e.twist for e in recording.episodes])
    measured = [bool(np.isfinite(twist[:, k]).any()) for k in range(2 * len(AXES))]
    kept = [k for k, there in enumerate(measured) if there and stated[k // len(AXES)]]
    columns = [("position", k, name, "m") for k, name in enumerate(AXES)]
    columns += [("orientation", k, f"{QUAT}.{name}", "rad") for k, name in enumerate(AXES)]
    columns += [("velocity", k, f"v{AXES[k]}", "m/s") for k in kept if k < len(AXES)]
    columns += [("angular_velocity", k - 3, f"w{AXES[k - 3]}", "rad/s") for k in kept if k >= len(AXES)]
    sources = tuple(ChannelSource(name, "body", BODY, quantity, k, unit) for quantity, k, name, unit in columns)
    driven = any(np.isfinite(e.force_n).any() for e in recording.episodes)
    mapping = ModelMapping(
        commands={},
        forces=(ForceColumns(BODY, FORCE, POINT),) if driven else (),
        sources=sources,
        orientations=(OrientationColumns(QUAT, ("qw", "qx", "qy", "qz")),),
        noise=_noise(recording, sources),
        rests=False,
    )
    left = {"velocity": "vx, vy, vz", "rate": "wx, wy, wz"}
    notes = [
        f"{names} are not counted, as no `noise: {{{key}: ...}}` is stated: computed from poses they tell nothing more"
        for k, (key, names) in enumerate(left.items())
        if not stated[k] and any(measured[k * len(AXES) : (k + 1) * len(AXES)])
    ]
    return MechanismSystem(
        with_episode_to_check(
            FreeBoxRecording(
                path=recording.path,
                model_path=_folder(recording.path) / FILE,
                mapping=mapping,
                episodes=tuple(_episode(e, recording.path, kept, driven=driven) for e in recording.episodes),
                notes=(*recording.notes, *notes),
                xml=mjcf(recording.nominal),
            )
        )
    )


def _folder(path: Path) -> Path:
    return path.parent if path.suffix in (".parquet", ".csv") else path


def _noise(recording: Recording, sources: tuple[ChannelSource, ...]) -> dict[str, float]:
    """Return the stated noise by channel; what the planar form calls yaw is any turn."""
    noise = recording.nominal.noise
    stated = {
        "position": noise.position_m,
        "orientation": noise.yaw_rad,
        "velocity": noise.velocity_m_s,
        "angular_velocity": noise.rate_rad_s,
    }
    return {s.name: level for s in sources if (level := stated[s.quantity]) is not None}


def _episode(episode: Episode, path: Path, kept: list[int], *, driven: bool) -> MechanismEpisode:
    """Return an episode with poses, the velocities that count, and the force where there is one."""
    n = len(episode)
    for name, values in (("x, y, z", episode.pose[:, :3]), ("qw, qx, qy, qz", episode.pose[:, 3:])):
        if not np.isfinite(values).all(axis=1).any():
            raise RecordingError(f"{path}: episode {episode.index}: {name} are nowhere measured (NaN in all rows).")
    return MechanismEpisode(
        index=episode.index,
        t_s=episode.t_s,
        values=np.hstack([episode.pose[:, :3], np.zeros((n, 3)), episode.twist[:, kept]]),
        commands=np.zeros((n, 0)),
        forces_n=_force(episode, path)[:, None] if driven else np.zeros((n, 0, 3)),
        points_m=np.nan_to_num(episode.point_m)[:, None] if driven else np.zeros((n, 0, 3)),
        orientations={QUAT: episode.pose[:, 3:]},
    )


def _force(episode: Episode, path: Path) -> FloatArray:
    """Return the force at every sample; one that is not measured at all in an episode is none."""
    known = np.isfinite(episode.force_n).all(axis=1)
    if known.any() and not known.all():
        row = int(np.argmin(known))
        raise RecordingError(
            f"{path}: episode {episode.index}, t = {episode.t_s[row]:.6g} s: fx, fy, fz are not measured (NaN) here "
            "but elsewhere in the episode; a force must be there at every sample, 0 where there is none."
        )
    return np.nan_to_num(episode.force_n)
