"""What can be planted in a body by Drake, drawn at random but for its size."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from runner.blind.drake_body.files import name_of
from runner.blind.drake_body.physics import World
from runner.blind.draws import draw_sign
from runner.effects.mechanism.contacts import damping_for, rebound
from runner.errors import ConfigError, nearest


@dataclass(frozen=True)
class UnplantedBody:
    """A case before anything is planted: the world as it is believed, and where the body goes in it, (T, 7) each."""

    world: World
    paths: Sequence[np.ndarray]

    def end(self, g: np.random.Generator) -> tuple[float, float]:
        """Return a place on the table near which an episode ends."""
        path = self.paths[int(g.integers(len(self.paths)))]
        x, y = path[-1, :2] + g.normal(0.0, 0.02, 2)
        return float(x), float(y)


@dataclass(frozen=True)
class BodyPlant:
    """One effect, drawn but for its size.

    Args:
        name: Of the vocabulary, or of what it does not have.
        target: What it changes; None: the whole, or nothing that a verdict could name.
        largest: Largest size that is physically sensible; sizes are positive, zero is no effect at all.
        edit: World and size to the world with the effect.
        true: Believed world and size to the true values under the names that a verdict has for them, SI units.
    """

    name: str
    target: str | None
    largest: float
    edit: Callable[[World, float], World]
    true: Callable[[World, float], dict[str, float]]

    @property
    def full(self) -> str:
        """The effect's name as a verdict has it."""
        return self.name if self.target is None else f"{self.name}[{self.target}]"


def _way(g: np.random.Generator, count: int) -> np.ndarray:
    way = g.standard_normal(count)
    return way / np.linalg.norm(way)


def _friction(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    s = draw_sign(g)
    return BodyPlant(
        "friction", name_of(c.world), 1.4,
        lambda w, size: replace(w, friction=w.friction * math.exp(s * size)),
        lambda w, size: {"mu": w.friction * math.exp(s * size)},
    )  # fmt: skip


def _restitution(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    """The share of the speed that is left, from what a critically damped spring leaves to what steps still resolve."""
    before = rebound(c.world.damping_ratio)
    s = draw_sign(g)
    largest = 0.65 - before if s > 0.0 else before - 0.14

    def ratio(w: World, size: float) -> float:
        return rebound(w.damping_ratio) + s * size

    def edit(w: World, size: float) -> World:
        return replace(w, relaxation_s=2.0 * damping_for(ratio(w, size)) / w.bounce_rad_s)

    return BodyPlant("restitution", name_of(c.world), largest, edit, lambda w, size: {"ratio": ratio(w, size)})


def _contact_stiffness(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    def edit(w: World, size: float) -> World:
        return replace(
            w, stiffness_n_per_m=w.stiffness_n_per_m * math.exp(-size), relaxation_s=w.relaxation_s * math.exp(size / 2)
        )

    return BodyPlant("contact_stiffness", name_of(c.world), 3.5, edit, lambda w, size: {"ratio": math.exp(-size)})


def _inertia(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    s = draw_sign(g)
    return BodyPlant(
        "inertia", name_of(c.world), 1.2, lambda w, size: replace(w, inertia=w.inertia * math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
    )  # fmt: skip


def _com_offset(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    x, y, z = (float(v) for v in _way(g, 3) * c.world.half_size)
    return BodyPlant(
        "com_offset", name_of(c.world), 0.6, lambda w, size: replace(w, com=(size * x, size * y, size * z)),
        lambda w, size: {"x_m": size * x, "y_m": size * y, "z_m": size * z},
    )  # fmt: skip


def _body_size(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    """The inertia is that of a uniform body, and goes with the size."""
    s = draw_sign(g)

    def edit(w: World, size: float) -> World:
        hx, hy, hz = (h * math.exp(s * size) for h in w.half_size)
        return replace(w, half_size=(hx, hy, hz))

    return BodyPlant("body_size", name_of(c.world), 0.35, edit, lambda w, size: {"ratio": math.exp(s * size)})


def _gravity(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    s = draw_sign(g)
    return BodyPlant(
        "gravity", None, 0.5, lambda w, size: replace(w, gravity=w.gravity * math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
    )  # fmt: skip


def _leaning(name: str, field: str, g: np.random.Generator) -> BodyPlant:
    x, y = (float(v) for v in _way(g, 2))
    return BodyPlant(
        name, None, 0.3, lambda w, size: replace(w, **{field: (size * x, size * y)}),
        lambda w, size: {"tilt_x_rad": size * x, "tilt_y_rad": size * y},
    )  # fmt: skip


def _gravity_tilt(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    return _leaning("gravity", "lean", g)


def _frame_tilt(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    return _leaning("frame_tilt", "tilt", g)


def _air_drag(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    unit = c.world.mass
    return BodyPlant(
        "air_drag", name_of(c.world), 2.0, lambda w, size: replace(w, air_drag=size * unit),
        lambda w, size: {"coefficient_n_s2_per_m2": size * unit},
    )  # fmt: skip


def _rotational_damping(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    unit = float(np.mean(c.world.uniform_inertia))
    return BodyPlant(
        "rotational_damping", name_of(c.world), 10.0, lambda w, size: replace(w, rotational_damping=size * unit),
        lambda w, size: {"damping_n_m_s": size * unit},
    )  # fmt: skip


def _clock_scale(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    s = draw_sign(g)
    return BodyPlant(
        "clock_scale", None, 0.3, lambda w, size: replace(w, clock=math.exp(s * size)),
        lambda w, size: {"ratio": math.exp(s * size)},
    )  # fmt: skip


def _sensor_offset(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    unit = draw_sign(g) * min(c.world.half_size)
    return BodyPlant(
        "sensor_offset", "z", 1.0, lambda w, size: replace(w, raised_m=size * unit),
        lambda w, size: {"offset": size * unit},
    )  # fmt: skip


VOCABULARY: dict[str, Callable[[UnplantedBody, np.random.Generator], BodyPlant]] = {
    f.__name__[1:]: f
    for f in (
        _friction, _restitution, _contact_stiffness, _inertia, _com_offset, _body_size, _gravity, _gravity_tilt,
        _frame_tilt, _air_drag, _rotational_damping, _clock_scale, _sensor_offset,
    )
}  # fmt: skip
# Pairs that write the same, or of which one takes the place of the other in flight.
TOGETHER_ALIKE = (
    {"gravity", "gravity_tilt"}, {"gravity_tilt", "frame_tilt"}, {"gravity", "clock_scale"},
    {"restitution", "contact_stiffness"}, {"body_size", "inertia"}, {"body_size", "sensor_offset"},
)  # fmt: skip


def _strange(name: str, largest: float, fields: Callable[[float], dict[str, object]], **true: float) -> BodyPlant:
    return BodyPlant(
        name, None, largest, lambda w, size: w.with_strange(**fields(size)), lambda w, size: {"size": size, **true}
    )


def _magnet(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    place, reach, unit = c.end(g), float(g.uniform(0.08, 0.25)), c.world.mass * c.world.gravity
    return _strange(
        "magnet", 3.0, lambda size: {"magnet_n": size * unit, "magnet_place": place, "magnet_reach_m": reach},
        unit_n=unit, x_m=place[0], y_m=place[1], reach_m=reach,
    )  # fmt: skip


def _fan(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    way, width, unit = float(g.uniform(-math.pi, math.pi)), float(g.uniform(0.05, 0.15)), c.world.mass * c.world.gravity
    x, y = c.end(g)
    at = x * -math.sin(way) + y * math.cos(way)
    return _strange(
        "fan", 1.5,
        lambda size: {"fan_n": size * unit, "fan_direction": way, "fan_place_m": at, "fan_width_m": width},
        unit_n=unit, direction_rad=way, place_m=at, width_m=width,
    )  # fmt: skip


def _magnus(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    unit = 0.1 * draw_sign(g) * c.world.mass
    return _strange("magnus", 4.0, lambda size: {"magnus_kg": size * unit}, unit_kg=unit)


def _loose_mass(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    hz, damping = float(g.uniform(2.0, 8.0)), float(g.uniform(0.05, 0.3))
    return _strange(
        "loose_mass", 0.7, lambda size: {"loose_share": size, "loose_hz": hz, "loose_damping": damping},
        frequency_hz=hz, damping=damping,
    )  # fmt: skip


def _giving_table(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    return _strange("giving_table", 0.03, lambda size: {"give_m": size})


def _worn_corners(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    x, y, z = (float(v) for v in _way(g, 3))
    unit = min(c.world.half_size)
    return _strange(
        "worn_corners", 0.8, lambda size: {"worn_m": size * unit, "worn_side": (x, y, z)}, unit_m=unit, x=x, y=y, z=z
    )


def _sticky_spot(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    place, reach, unit = c.end(g), float(g.uniform(0.06, 0.2)), 10.0 * c.world.mass
    return _strange(
        "sticky_spot", 10.0,
        lambda size: {"sticky_kg_per_s": size * unit, "sticky_place": place, "sticky_reach_m": reach},
        unit_kg_per_s=unit, x_m=place[0], y_m=place[1], reach_m=reach,
    )  # fmt: skip


def _marker(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    x, y, z = (float(v) for v in _way(g, 3) * c.world.half_size)
    return _strange("marker", 1.0, lambda size: {"marker": (size * x, size * y, size * z)}, x_m=x, y_m=y, z_m=z)


def _yaw_drift(c: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    unit = draw_sign(g)
    return _strange("yaw_drift", 6.0, lambda size: {"yaw_drift_rad_s": size * unit}, unit_rad_s=unit)


OUTSIDE: dict[str, Callable[[UnplantedBody, np.random.Generator], BodyPlant]] = {
    f.__name__[1:]: f
    for f in (
        _magnet, _fan, _magnus, _loose_mass, _giving_table, _worn_corners, _sticky_spot, _marker, _yaw_drift,
    )
}  # fmt: skip


def draw(name: str, case: UnplantedBody, g: np.random.Generator) -> BodyPlant:
    """Draw an effect by name.

    Raises:
        ConfigError: If there is none of that name.
    """
    every = {**VOCABULARY, **OUTSIDE}
    if name not in every:
        raise ConfigError(f"blind.effect: no effect '{name}'. {nearest(name, every)}")
    return every[name](case, g)
