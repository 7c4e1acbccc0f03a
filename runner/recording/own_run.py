"""A folder that `runner run` left, as a recording: the remote object is what was measured, the start what is believed.

Of the columns of `frames.parquet` those of the remote object are the measurement, without noise; the force of
a frame is that of the step which led to it, here it is that of the row before. What is believed of the object stands
in `config.yaml`: the remote's shape, the start's mass, centre of mass, inertia and friction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from runner.errors import RecordingError
from runner.numerics.arrays import FloatArray
from runner.recording.data import Noise, Nominal, Support
from runner.recording.raw_table import numbers, read_raw
from runner.recording.table import Table
from runner.storage.yaml_text import YamlError, read_yaml

FRAMES, CONFIG = "frames.parquet", "config.yaml"
MEASURED = {
    "x": "remote_x_m",
    "y": "remote_y_m",
    "yaw": "remote_yaw_rad",
    "vx": "remote_vx_m_s",
    "vy": "remote_vy_m_s",
    "wz": "remote_wz_rad_s",
}
COMMANDED = {"fx": "force_x_n", "fy": "force_y_n", "px": "point_x_m", "py": "point_y_m", "pz": "point_z_m"}
NOTE = (
    "an experiment holds the truth without noise: noises are those of its link, or 0.1 mm, 0.1 mrad, 1 mm/s, 1 mrad/s"
)
EXACT = {"position_m": 1e-4, "angle_rad": 1e-4, "velocity_m_s": 1e-3, "rate_rad_s": 1e-3}  # as a good sensor's
NOISE = {"position_m": "position_m", "angle_rad": "yaw_rad", "velocity_m_s": "velocity_m_s", "rate_rad_s": "rate_rad_s"}


def is_run(folder: Path) -> bool:
    """Tell whether a folder holds what an experiment left."""
    return all((folder / name).is_file() for name in (FRAMES, CONFIG))


def read_run(folder: Path) -> tuple[Table, Nominal]:
    """Return the motion of the remote object as one episode in planar form, and what the local side began with.

    Raises:
        RecordingError: If it is no run of one box on a floor whose updates come at even times, or a file is broken.
    """
    path = folder / FRAMES
    raw = read_raw(path)
    lacking = [name for name in ("time_s", *MEASURED.values(), *COMMANDED.values()) if name not in raw.header]
    if lacking:
        raise RecordingError(
            f"{path}: no column '{lacking[0]}'; of all runs those of a box with dof: planar can be replayed, whose "
            "frames hold its pose and twist."
        )
    columns = {name: numbers(path, source, raw) for name, source in MEASURED.items()}
    columns |= {name: _of_row_before(numbers(path, source, raw)) for name, source in COMMANDED.items()}
    sent = numbers(path, "sent_s", raw) if "sent_s" in raw.header else numbers(path, "time_s", raw)
    columns |= {"t": sent, "episode": np.zeros(len(sent))}
    return Table(path, columns, notes=[NOTE]), _believed(folder / CONFIG)


def _of_row_before(column: FloatArray) -> FloatArray:
    return np.append(column[1:], column[-1:])


def _believed(path: Path) -> Nominal:
    try:
        content = read_yaml(path)
        remote, start, scene = content["remote"], content["start"], content["scene"]
        return Nominal(
            half_size_m=_triple(remote["half_size_m"]),
            mass_kg=start["mass_kg"],
            friction=remote["friction"] if start["friction"] is None else start["friction"],
            gravity_m_s2=scene["gravity_m_s2"],
            rate_hz=content["link"]["rate_hz"],
            contact=Support(scene["contact"]),
            noise=_noise(content["link"]["noise"]),
            com_m=None if start["com_m"] is None else _triple(start["com_m"]),
            inertia_kg_m2=None if start["inertia_kg_m2"] is None else _triple(start["inertia_kg_m2"]),
            path=path,
        )
    except YamlError as error:
        raise RecordingError(f"{path}:{error}") from None
    except (KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{path}: does not say what the run began with ({error}).") from None


def _triple(values: Sequence[float]) -> tuple[float, float, float]:
    x, y, z = map(float, values)
    return x, y, z


def _noise(stated: Mapping[str, Any]) -> Noise:
    """Return what a gap is to be measured by: the noise of the link, and where it has none that of a good sensor."""
    return Noise(**{ours: float(stated[theirs]) or EXACT[theirs] for theirs, ours in NOISE.items()})
