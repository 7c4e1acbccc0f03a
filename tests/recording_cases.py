"""Recordings for the tests of what is read: motions whose poses are the integrals of their velocities."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from runner.recording import (
    Episode,
    Form,
    Noise,
    Nominal,
    Recording,
    Support,
    write_case,
)

EXAMPLES = Path(__file__).parent.parent / "examples"
RATE_HZ = 60.0
NOMINAL = Nominal((0.5, 0.5, 0.5), 3.0, 0.3, 9.81, RATE_HZ)
BELIEVED = {"half_size": 0.5, "mass": 3.0, "friction": 0.3, "gravity": 9.81, "rate_hz": 60}
SAVED = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


def planar_episode(index: int, count: int = 121) -> Episode:
    """A box that swings along a bow while it turns to and fro; poses are the integrals of the velocities."""
    t = np.arange(count) / RATE_HZ
    a = 0.5 + 0.1 * index
    pose = np.stack([a * (1 - np.cos(2 * t)) / 2, 0.3 * np.sin(t + index), (1 - np.cos(3 * t)) * 0.5], axis=1)
    twist = np.stack([a * np.sin(2 * t), 0.3 * np.cos(t + index), 1.5 * np.sin(3 * t)], axis=1)
    force = np.stack([np.where(t < 1, 2.0, 0.0), np.where(t < 1, -1.0, 0.0), 0 * t], axis=1)
    point = np.where(t[:, None] < 1, [0.1, -0.2, 0.05], 0.0)
    return Episode(index, t, pose, twist, force, point)


def spatial_episode(index: int, count: int = 61) -> Episode:
    """A tumbling throw: constant rate about a skew axis, from above."""
    t = np.arange(count) / RATE_HZ
    rate = np.array([1.0 + index, -2.0, 1.5])
    xyzw = Rotation.from_rotvec(t[:, None] * rate).as_quat(canonical=True)
    wxyz = xyzw[:, [3, 0, 1, 2]]
    flips = np.where(np.sum(wxyz[1:] * wxyz[:-1], axis=1) < 0, -1.0, 1.0)
    wxyz[1:] *= np.cumprod(flips)[:, None]
    where = np.stack([t, 0.2 * t, 3.0 + 0.5 * t - 4.905 * t**2], axis=1)
    speed = np.stack([1 + 0 * t, 0.2 + 0 * t, 0.5 - 9.81 * t], axis=1)
    twist = np.hstack([speed, np.tile(rate, (count, 1))])
    nothing = np.full((count, 3), np.nan)
    return Episode(index, t, np.hstack([where, wxyz]), twist, nothing, nothing)


def planar() -> Recording:
    return Recording(Path("planar"), Form.PLANAR, NOMINAL, tuple(planar_episode(i) for i in range(3)))


def spatial() -> Recording:
    return Recording(Path("spatial"), Form.SPATIAL, NOMINAL, tuple(spatial_episode(i) for i in range(2)))


def assert_same(one: Recording, other: Recording) -> None:
    assert (one.form, one.nominal, len(one.episodes)) == (other.form, other.nominal, len(other.episodes))
    for a, b in zip(one.episodes, other.episodes, strict=True):
        assert a.index == b.index
        for name in ("t_s", "pose", "twist", "force_n", "point_m"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


def notes_of(recording: Recording) -> tuple[str, ...]:
    """Return what is noted of a recording, but for its forces: those of `planar_episode` do not cause its motion."""
    return tuple(note for note in recording.notes if "the forces 'fx', 'fy' explain" not in note)


def frame_of(recording: Recording, folder: Path) -> pd.DataFrame:
    write_case(recording, folder)
    return pd.read_parquet(folder / "recording.parquet")


@st.composite
def nominals(draw: st.DrawFn) -> Nominal:
    size = st.floats(0.05, 2.0)
    sizes = draw(st.one_of(st.tuples(size, size, size), size.map(lambda h: (h, h, h))))
    mass = draw(st.floats(1.0, 1000.0)) * 8 * sizes[0] * sizes[1] * sizes[2]
    unknown = st.none() | st.floats(1e-6, 1.0)
    moment = 0.3 * mass * (sizes[0] ** 2 + sizes[1] ** 2)
    return Nominal(
        half_size_m=sizes,
        mass_kg=mass,
        friction=draw(st.floats(0.0, 2.0)),
        gravity_m_s2=draw(st.floats(1.0, 25.0)),
        rate_hz=draw(st.floats(1.0, 1000.0)),
        contact=draw(st.sampled_from(list(Support))),
        noise=Noise(*(draw(unknown) for _ in range(4))),
        com_m=draw(st.none() | st.tuples(*[st.floats(-0.05, 0.05)] * 3)),
        inertia_kg_m2=draw(st.sampled_from([None, moment, (moment, 0.9 * moment, 1.1 * moment)])),
        known=draw(st.sampled_from([(), ("mass", "friction_patch")])),
    )
