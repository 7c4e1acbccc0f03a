"""What is simulated: a box and its floor, how roughly pushes are carried out, and what no vocabulary has a word for."""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from runner.blind.planar_box.physics import World
from runner.errors import ConfigError, check_range

# of a world: what Drake's contact, or our forces upon it, do not express
BEYOND = (
    "anisotropy", "periodic", "cogging", "deflection", "wear", "wander", "barrier", "vortex",
)  # fmt: skip


@dataclass(frozen=True)
class Strange:
    """What the vocabulary has no word for. Every default is neutral. SI units, radians."""

    magnet: float = 0.0  # N, greatest pull towards a place, at `magnet_reach` from it
    magnet_place: tuple[float, float] = (0.0, 0.0)
    magnet_reach: float = 0.3
    root_drag: float = 0.0  # N (s/m)^0.5, resistance with the root of the speed
    caster: float = 0.0  # N s/m, resistance of a wheel to moving across its heading
    caster_place: tuple[float, float] = (0.0, 0.0)  # body axes
    caster_angle: float = 0.0  # of its rolling direction, body axes
    nap: float = 0.0  # relative change of friction with the world direction of slip: 1 + nap cos(slip - direction)
    nap_direction: float = 0.0
    vibration: float = 0.0  # relative change of friction in time, as of a shaking floor
    vibration_hz: float = 3.0
    vibration_phase: float = 0.0
    warming: float = 0.0  # 1/J, loss of friction for the work that it has done and that is not yet cooled off
    cooling_s: float = 3.0
    wall_distance: float | None = None  # m, of a wall n . r = distance that the corners of the box touch
    wall_direction: float = 0.0
    wall_friction: float = 0.2
    loose_share: float = 0.0  # of the mass, that lies loose inside, at the height of the centre
    loose_hz: float = 1.0  # at which it swings
    loose_damping: float = 0.1  # of critical
    dropouts: float = 0.0  # share of the time in which no push is carried out
    dropout_s: float = 0.1  # mean length of one
    dropout_seed: int = 0
    slew_n_per_s: float | None = None  # the fastest change of the force
    kick: float = 0.0  # N s, a blow in each episode that nobody commanded
    kick_direction: float = 0.0
    kick_at: float = 0.4  # share of the episode


@dataclass(frozen=True)
class Scene:
    """One world, whole.

    Args:
        world: The box and all around it that the vocabulary has words for.
        late: Every change of the push comes late by a share of a sample, drawn up to this one.
        late_seed: Of those draws.
        strange: What it has no words for.
    """

    world: World
    late: float = 0.0
    late_seed: int = 0
    strange: Strange = field(default_factory=Strange)

    def __post_init__(self) -> None:
        check_range("scene.late", self.late, 0.0, 1.0)
        defaults = {f.name: f.default for f in fields(World)}
        for name in BEYOND:
            if getattr(self.world, name) != defaults[name]:
                raise ConfigError(f"world.{name}: a world by Drake has none.")
