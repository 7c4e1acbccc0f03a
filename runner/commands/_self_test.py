"""Two motions whose outcome is known in closed form, simulated by what diagnoses recordings."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import ellipj, ellipk

from runner.api.arrays import case_from_arrays
from runner.recording import Episode, Form, Nominal, Recording
from runner.systems.planar_box.system import PlanarBox
from runner.systems.simulator import Run

GRAVITY = 9.81
SPEED_M_S, FRICTION = 2.0, 0.3
LENGTH_M, MASS_KG, INERTIA, SWING_RAD = 0.4, 1.5, 0.02, 1.0
ALLOWED = 1e-3  # relative
PENDULUM = f"""<mujoco><option gravity="0 0 -{GRAVITY}"/><worldbody><body name="lever">
<joint name="hinge" axis="0 -1 0"/>
<inertial pos="0 0 -{LENGTH_M}" mass="{MASS_KG}" diaginertia="{INERTIA} {INERTIA} {INERTIA}"/>
</body></worldbody></mujoco>"""


@dataclass(frozen=True)
class Comparison:
    """What came out, and what should have."""

    what: str
    unit: str
    simulated: float
    exact: float

    @property
    def off(self) -> float:
        """Relative deviation."""
        return abs(self.simulated / self.exact - 1.0) if math.isfinite(self.simulated) else math.inf

    @property
    def passed(self) -> bool:
        """Whether it is close enough."""
        return self.off < ALLOWED


def sliding() -> Comparison:
    """Let a box slide to rest: v^2 / (2 mu g)."""
    count, rate_hz = 91, 60.0
    still = np.zeros((count, 3))
    episode = Episode(0, np.arange(count) / rate_hz, still, still, still, still)
    nominal = Nominal((0.5, 0.5, 0.5), 3.0, FRICTION, GRAVITY, rate_hz)
    box = PlanarBox(Recording(Path("self-test"), Form.PLANAR, nominal, (episode,)))
    start = np.array([0.0, 0.0, 0.0, SPEED_M_S, 0.0, 0.0])
    motion = box.simulator(threads=1).predict(0, [Run((), start)])[0]
    return Comparison(
        "sliding distance, v²/(2 μ g)", "m", float(motion[-1, 0]), SPEED_M_S**2 / (2 * FRICTION * GRAVITY)
    )


def swinging() -> Comparison:
    """Let a pendulum swing: 4 sqrt(I / (m g l)) K(sin(a/2)), a complete elliptic integral."""
    modulus = math.sin(SWING_RAD / 2)
    own = math.sqrt(MASS_KG * GRAVITY * LENGTH_M / (INERTIA + MASS_KG * LENGTH_M**2))
    period_s = 4 * float(ellipk(modulus**2)) / own
    t = np.arange(1001) * 0.01
    sn, cn, dn, _ = ellipj(own * t + ellipk(modulus**2), modulus**2)
    angle, rate = 2 * np.arcsin(modulus * sn), 2 * modulus * own * cn * dn / np.sqrt(1 - (modulus * sn) ** 2)
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder) / "pendulum.xml"
        model.write_text(PENDULUM, encoding="utf-8")
        case = case_from_arrays(model, t=t, channels={"q_hinge": angle, "dq_hinge": rate})
    simulated = case.system.simulator(threads=1).predict(0, [Run((), np.array([SWING_RAD, 0.0]))])[0][:, 0]
    return Comparison(f"pendulum's period at {SWING_RAD:g} rad, elliptic", "s", _period(t, simulated), period_s)


def _period(t: np.ndarray, angle: np.ndarray) -> float:
    """Return the mean time between passages through zero in one direction; NaN: there are not two."""
    at = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    if len(at) < 2:
        return math.nan
    passages = t[at] - angle[at] * (t[at + 1] - t[at]) / (angle[at + 1] - angle[at])
    return float(np.diff(passages).mean())
