"""Effects that the vocabulary has no word for: the right answer to each is `unknown`."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from runner.blind.draws import draw_angle, draw_sign
from runner.blind.mechanism.case import Unplanted
from runner.blind.mechanism.draw import Needs
from runner.blind.mechanism.physics import World
from runner.blind.mechanism.physics.layout import WAVES
from runner.blind.mechanism.plants.plant import Kind, Plant


def _unknown(
    name: str, c: Unplanted, i: int, largest: float, edit: Callable[[World, float], World], **true: float
) -> Plant:
    told = {"joint": float(i), **true}
    return Plant(name, None, largest, edit, lambda w, size: {"size": size, **told}, ("unknown",))


def _joint(c: Unplanted, g: np.random.Generator) -> int:
    return int(g.integers(c.count))


def _quadratic_drag(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    unit = c.force(i) / c.speed(i) ** 2
    return _unknown("quadratic_drag", c, i, 1.5, lambda w, size: w.with_joint(i, quadratic=size * unit), unit=unit)


def _hardening_spring(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    unit, middle = c.force(i) / c.reach(i) ** 3, float(np.median(c.column(i, of_velocity=False)))
    return _unknown(
        "hardening_spring", c, i, 2.0, lambda w, size: w.with_joint(i, cubic=size * unit, cubic_rest=middle), unit=unit
    )


def _presliding_hysteresis(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    unit, rate = c.force(i), 1.0 / (c.reach(i) * float(g.uniform(0.15, 0.5)))
    return _unknown(
        "presliding_hysteresis", c, i, 1.0, lambda w, size: w.with_joint(i, dahl=size * unit, dahl_rate=rate),
        unit=unit, rate=rate,
    )  # fmt: skip


def _warm_up(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    total = c.episodes[-1].elapsed_s + c.episodes[-1].duration_s
    fades = total * float(g.uniform(0.2, 0.6))
    return _unknown("warm_up", c, i, 8.0, lambda w, size: w.with_joint(i, warm_up=size, warm_up_s=fades), fades_s=fades)


def _rough_place(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    width = c.reach(i) * float(g.uniform(0.15, 0.35))
    place = float(np.median(c.column(i, of_velocity=False)) + g.uniform(-0.6, 0.6) * c.reach(i))
    dry = c.world.joints[i].dry
    unit = c.force(i)

    # of the dry friction there is, so that there must be some
    def edit(w: World, size: float) -> World:
        return w.with_joint(i, patch=size * unit / dry, patch_at=place, patch_width=width)

    return _unknown("rough_place", c, i, 1.5, edit, place=place, width=width)


def _soft_stop(c: Unplanted, g: np.random.Generator) -> Plant:
    i, side = _joint(c, g), draw_sign(g)
    places = side * c.column(i, of_velocity=False)
    top, middle = float(places.max()), float(np.median(places))
    stiffness = 8.0 * c.force(i) / c.reach(i)

    def edit(w: World, size: float) -> World:
        place = side * (top + size * (middle - top))
        return w.with_joint(i, stop_stiffness=stiffness, stop_at=place, stop_side=side)

    return _unknown("soft_stop", c, i, 0.9, edit, stiffness=stiffness, side=side)


def _vibration(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    unit, hz, angle = c.force(i), float(g.uniform(0.4, 3.0)), draw_angle(g)
    return _unknown(
        "vibration", c, i, 1.0, lambda w, size: w.with_joint(i, swings=((size * unit, hz, angle),)), hz=hz, unit=unit
    )


def _wandering_torque(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    unit = c.force(i) / math.sqrt(WAVES / 2.0)
    waves = [(float(hz), draw_angle(g)) for hz in np.exp(g.uniform(math.log(0.1), math.log(2.0), WAVES))]

    def edit(w: World, size: float) -> World:
        return w.with_joint(i, swings=tuple((size * unit, hz, angle) for hz, angle in waves))

    return _unknown("wandering_torque", c, i, 1.0, edit, unit=unit)


def _one_sided_gain(c: Unplanted, g: np.random.Generator) -> Plant:
    i, s = _joint(c, g), draw_sign(g)
    return _unknown("one_sided_gain", c, i, 0.6, lambda w, size: w.with_actuator(i, one_sided=s * size), sign=s)


def _fading_gain(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    usual, lasts = 0.6 * c.peak(i), c.shortest_s * float(g.uniform(0.15, 0.5))
    return _unknown(
        "fading_gain", c, i, 0.8, lambda w, size: w.with_actuator(i, fade=size, fade_s=lasts, fade_force=usual),
        lasts_s=lasts, usual_force=usual,
    )  # fmt: skip


def _slipping_coupling(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    share, peak = float(g.uniform(0.3, 0.8)), 1.1 * c.peak(i)
    return _unknown(
        "slipping_coupling", c, i, 0.8, lambda w, size: w.with_actuator(i, slip=share, slip_at=peak * (1.0 - size)),
        share=share, peak=peak,
    )  # fmt: skip


def _crosstalk(c: Unplanted, g: np.random.Generator) -> Plant:
    i, s = _joint(c, g), draw_sign(g)
    return _unknown("crosstalk", c, i, 0.4, lambda w, size: w.with_actuator(i, crosstalk=s * size), sign=s)


def _quantised_command(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    unit = c.largest_command(i)
    return _unknown("quantised_command", c, i, 1.0, lambda w, size: w.with_actuator(i, quantum=size * unit), unit=unit)


def _slew_limit(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    unit = c.largest_command(i)
    return _unknown(
        "slew_limit", c, i, 1.0, lambda w, size: w.with_actuator(i, slew_per_s=2.0 * unit / size), unit=unit
    )


def _jittery_command(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    return _unknown("jittery_command", c, i, 0.15, lambda w, size: w.with_actuator(i, jitter_s=size))


def _lost_commands(c: Unplanted, g: np.random.Generator) -> Plant:
    i = _joint(c, g)
    return _unknown("lost_commands", c, i, 0.95, lambda w, size: w.with_actuator(i, dropout=size))


OUTSIDE: dict[str, Kind] = {
    f.__name__[1:]: Kind(f)
    for f in (
        _quadratic_drag, _hardening_spring, _presliding_hysteresis, _warm_up, _soft_stop, _vibration,
        _wandering_torque, _one_sided_gain, _fading_gain, _slipping_coupling, _quantised_command, _slew_limit,
        _jittery_command, _lost_commands,
    )
}  # fmt: skip
OUTSIDE |= {
    "rough_place": Kind(_rough_place, Needs(dry=True)),
    "crosstalk": Kind(_crosstalk, systems=("arm2",)),
}
