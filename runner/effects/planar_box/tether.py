"""A spring to a fixed point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from dm_control import mjcf

from runner.effects.base import Parameter, Phrase, Vector
from runner.effects.planar_box.base import Beliefs, Context, PlanarEffect, Target, effect
from runner.effects.wording import Values, number
from runner.errors import check_range


@effect
@dataclass(frozen=True)
class Tether(PlanarEffect):
    """A spring from the geometric centre to a fixed point at its height; slack when shorter than `rest_length_m`."""

    name: ClassVar[str] = "tether"
    label: ClassVar[str] = "a spring to a fixed point"
    structural: ClassVar[bool] = True
    stiffness_n_per_m: float
    x_m: float
    y_m: float
    rest_length_m: float = 0.0

    def __post_init__(self) -> None:
        check_range("tether.stiffness_n_per_m", self.stiffness_n_per_m, 0.0, 1e6, unit="N/m")
        check_range("tether.x_m", self.x_m, -1e4, 1e4, unit="m")
        check_range("tether.y_m", self.y_m, -1e4, 1e4, unit="m")
        check_range("tether.rest_length_m", self.rest_length_m, 0.0, 1e4, unit="m")

    def edit_mjcf(self, root: mjcf.RootElement, body: str) -> None:
        element = root.find("body", body)
        height = float(element.pos[2])
        root.worldbody.add("site", name=f"{body}_tether_anchor", pos=(0, 0, height))
        element.add("site", name=f"{body}_tether", pos=(0, 0, 0))
        tendon = root.tendon.add("spatial", name=f"{body}_tether", stiffness=1.0, springlength=(0.0, 1.0))
        tendon.add("site", site=f"{body}_tether_anchor")
        tendon.add("site", site=f"{body}_tether")

    def edit_model(self, target: Target) -> None:
        model = target.model
        name = model.body(target.body_id).name
        anchor, tendon = model.site(f"{name}_tether_anchor").id, model.tendon(f"{name}_tether").id
        model.site_pos[anchor, :2] = (self.x_m, self.y_m)
        model.tendon_stiffness[tendon] = self.stiffness_n_per_m
        model.tendon_lengthspring[tendon] = (0.0, self.rest_length_m)

    @classmethod
    def parameters(cls, context: Context) -> tuple[Parameter, ...]:
        (cx, cy), reach = context.centre_m, context.reach_m
        stiffness = 0.1 * context.friction_n / max(reach, 0.1)
        return (
            Parameter("stiffness_n_per_m", "N/m", stiffness, 0.0, 200 * stiffness),
            Parameter("x_m", "m", reach, cx - 3 * reach, cx + 3 * reach),
            Parameter("y_m", "m", reach, cy - 3 * reach, cy + 3 * reach),
            Parameter("rest_length_m", "m", reach / 2, 0.0, 6 * reach, may_rest=True),
        )

    @classmethod
    def from_vector(cls, x: Vector, context: Context) -> Self:
        return cls(max(x[0], 0.0), x[1], x[2], max(x[3], 0.0))

    @classmethod
    def starts(cls, context: Context) -> np.ndarray:
        (cx, cy), reach = context.centre_m, context.reach_m
        stiffness = 0.1 * context.friction_n / max(reach, 0.1)
        grid = np.array([-1.2, 0.0, 1.2]) * reach
        taut = [[stiffness, cx + a, cy + b, 0.1 * reach] for a in grid for b in grid]
        return np.array([*taut, [stiffness, cx, cy, 0.7 * reach]])

    @classmethod
    def phrase(cls, of: Values, beliefs: Beliefs, target: str | None = None) -> Phrase:
        return Phrase(
            "something pulls the object towards a fixed point like a spring",
            f"{of.show('stiffness_n_per_m', 'N/m')} towards {of.place()}, slack below {of.long('rest_length_m')}",
            f"Add a spring of {number(of['stiffness_n_per_m'])} N/m and rest length {number(of['rest_length_m'])} m to "
            f"the point {of.place()}.",
            "Look for a cable or hose that pulls.",
        )
