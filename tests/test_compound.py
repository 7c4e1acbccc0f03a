"""Ten free numbers are a possible body whatever they are, and a hanging compound object gives them away."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from runner.errors import ConfigError
from runner.physics.forces import Straight
from runner.physics.scene import BodyConfig, Dof, FloorContact, SceneConfig, build
from runner.studies.compound import (
    HUNG,
    NOISE,
    Compound,
    Inertial,
    Part,
    Poke,
    PokeSimulator,
    compound_mjcf,
    differences,
    fit,
    from_vector,
    inertial_in,
    pseudo_inertia,
    to_vector,
    with_noise,
    write_inertial,
)
from runner.teleop.estimators import Linear
from runner.teleop.experiment import REMOTE, Experiment, RemoteConfig, StartConfig
from runner.teleop.link import LinkConfig

SCENE = SceneConfig(dof=Dof.free, contact=FloorContact.corners)
HALF = (0.5, 0.5, 0.5)
PARTS = [Part((0.5, 0.5, 0.05), (0.0, 0.0, -0.45), 10.0), Part((0.2, 0.2, 0.2), (0.25, 0.2, -0.15), 30.0)]


@given(st.lists(st.floats(-2.0, 2.0), min_size=10, max_size=10))
def test_any_ten_numbers_are_a_possible_body(numbers: list[float]) -> None:
    """The moments are positive and keep the triangle inequality; the numbers come back."""
    x = np.array(numbers)
    body = from_vector(x, np.array(HALF))
    moments = np.linalg.eigvalsh(body.inertia_kg_m2)
    assert body.mass_kg > 0
    assert moments[0] > 0
    assert moments[0] + moments[1] > moments[2]
    assert np.linalg.eigvalsh(pseudo_inertia(body))[0] > 0
    np.testing.assert_allclose(to_vector(body, np.array(HALF)), x, atol=1e-6)


def test_mujoco_composes_the_parts() -> None:
    """Mass, centre and inertia are those of the boxes by the parallel-axis theorem."""
    mass = np.array([8 * np.prod(p.half_size_m) * p.density_kg_m3 for p in PARTS])
    centre = np.array([p.centre_m for p in PARTS])
    com = mass @ centre / mass.sum()
    inertia = np.zeros((3, 3))
    for m, c, part in zip(mass, centre, PARTS, strict=True):
        a, b, h = np.square(part.half_size_m)
        off = c - com
        inertia += np.diag([b + h, a + h, a + b]) * m / 3 + m * (off @ off * np.eye(3) - np.outer(off, off))
    found = PokeSimulator(SCENE, compound_mjcf(SCENE, 0.8, HALF, PARTS), HUNG[:1], duration_s=0.1, lead_s=0, rate_hz=60)
    body = inertial_in(found.model, found.body_id)
    assert body.mass_kg == pytest.approx(mass.sum())
    np.testing.assert_allclose(body.com_m, com, atol=1e-12)
    np.testing.assert_allclose(body.inertia_kg_m2, inertia, atol=1e-12)


def test_one_box_with_the_same_ten_numbers_moves_alike() -> None:
    """Hanging and standing, pushed at any height: the fitted form is as good as the parts."""
    for pokes in (HUNG[:3], (Poke((27.0, 0.0, 0.0), (-0.5, 0.0, 0.5)),)):
        remote = PokeSimulator(
            SCENE, compound_mjcf(SCENE, 0.8, HALF, PARTS), pokes, duration_s=0.5, lead_s=0, rate_hz=60
        )
        box = build(SCENE, {REMOTE: BodyConfig(1.0, 0.8, HALF)})
        local = PokeSimulator(SCENE, box, pokes, duration_s=0.5, lead_s=0, rate_hz=60)
        true = inertial_in(remote.model, remote.body_id)
        moved = remote.run([true])
        np.testing.assert_allclose(local.run([true]), moved, atol=1e-9)
        assert np.abs(differences(moved[0, :, -1], moved[0, :, 0])).max() > 0.05


def test_what_is_written_is_read_back() -> None:
    """A full inertia goes through MuJoCo's principal axes and comes back."""
    model = PokeSimulator(
        SCENE, build(SCENE, {REMOTE: BodyConfig(1.0, 0.8, HALF)}), HUNG[:1], duration_s=0.1, lead_s=0, rate_hz=60
    ).model
    body = from_vector(np.linspace(-0.5, 0.5, 10), np.array(HALF))
    write_inertial(model, mujoco.MjData(model), model.body(REMOTE).id, body)
    np.testing.assert_allclose(inertial_in(model, model.body(REMOTE).id).values, body.values, rtol=1e-12)


@pytest.mark.slow
def test_ten_parameters_from_a_hanging_object() -> None:
    """From half the mass and a centred uniform box: exact without noise, and within the stated errors with it."""
    remote = PokeSimulator(SCENE, compound_mjcf(SCENE, 0.8, HALF, PARTS), HUNG, duration_s=0.4, lead_s=0, rate_hz=60)
    box = BodyConfig(1.2, 0.8, HALF)
    local = PokeSimulator(SCENE, build(SCENE, {REMOTE: box}), HUNG, duration_s=0.4, lead_s=0, rate_hz=60)
    true = inertial_in(remote.model, remote.body_id)
    start = Inertial(box.mass_kg, np.zeros(3), np.diag(box.inertia))
    motion = remote.run([true])[0]
    exact = fit(local, motion, NOISE, start, np.array(HALF))
    np.testing.assert_allclose(exact.body.values, true.values, atol=1e-3)
    noisy = fit(local, with_noise(motion, NOISE, np.random.default_rng(0)), NOISE, start, np.array(HALF))
    error = noisy.body.values - true.values
    assert error @ np.linalg.solve(noisy.covariance, error) < 30  # chi-square, 10 degrees of freedom: 99.9 %
    assert noisy.loss == pytest.approx(1.0, abs=0.1)


def test_parts_that_reach_out_are_refused(tmp_path: Path) -> None:
    """A part outside the hull names itself."""
    remote = RemoteConfig(friction=0.8)
    base = Experiment(0, SCENE, Straight(), remote, StartConfig(), LinkConfig(), {"linear": Linear()})
    study = Compound(parts={"arm": Part((0.2, 0.2, 0.2), (0.4, 0.0, 0.0), 10.0)}, seeds=0)
    with pytest.raises(ConfigError, match=r"study.parts.arm: reaches out"):
        study.rows(base, tmp_path)
    with pytest.raises(ConfigError, match="parts: at least one"):
        Compound(parts={})
