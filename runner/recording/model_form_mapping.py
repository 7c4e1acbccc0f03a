"""The keys of `nominal.yaml` in the model form: how columns of a recording and elements of an MJCF belong together.

model: model.xml                 # MJCF, inside the folder; its numbers are the beliefs
commands:                        # recorded column -> what it drives, held from this sample to the next
  u_elbow: {actuator: elbow}
forces:                          # optional: recorded force on a body, N, world axes, at a point in body axes, m
  - {body: object, force: [fx, fy, fz], point: [px, py, pz]}
channels:                        # recorded column -> what it measures
  q: {joint: elbow, quantity: position}           # or velocity
  tau: {actuator: elbow, quantity: force}         # what the actuator exerts
  x: {body: object, quantity: position, axis: x}  # or velocity, angular_velocity; world axes
  quat: {body: object, quantity: orientation, columns: [qw, qx, qy, qz]}   # body to world
  gyro_z: {sensor: gyro, index: 2}                # any sensor of the MJCF
noise: {q: 0.001}                # standard deviations; missing or null: not known
start: free                      # or `rest`
known:                           # optional: effects that are not the case, as what they would change was measured
- mass[forearm]
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco

from runner.errors import RecordingError, nearest

KEYS = ("model", "commands", "forces", "channels", "noise", "start", "known")
STARTS = ("free", "rest")
AXES = ("x", "y", "z")
QUANTITIES = {
    "joint": ("position", "velocity"),
    "actuator": ("force",),
    "body": ("position", "velocity", "angular_velocity", "orientation"),
}
BODY_UNITS = {"position": "m", "velocity": "m/s", "angular_velocity": "rad/s", "orientation": "rad"}
SENSOR_UNITS = {
    "TOUCH": "N",
    "ACCELEROMETER": "m/s2",
    "VELOCIMETER": "m/s",
    "GYRO": "rad/s",
    "FORCE": "N",
    "TORQUE": "N m",
    "RANGEFINDER": "m",
    "FRAMEPOS": "m",
    "FRAMELINVEL": "m/s",
    "FRAMEANGVEL": "rad/s",
    "FRAMELINACC": "m/s2",
    "FRAMEANGACC": "rad/s2",
    "SUBTREECOM": "m",
    "SUBTREELINVEL": "m/s",
    "BALLANGVEL": "rad/s",
    "CLOCK": "s",
}
HINGE, SLIDE = int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)
SCALAR_JOINTS = {HINGE: "rad", SLIDE: "m"}
AT_JOINT = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
NO_BIAS, AFFINE_BIAS = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)


@dataclass(frozen=True)
class ChannelSource:
    """What one channel measures.

    Args:
        name: Of the channel: its column; of an orientation `COLUMN.x`, `.y`, `.z`.
        kind: joint | actuator | body | sensor.
        target: Name of that element.
        quantity: position | velocity | angular_velocity | orientation | force | sensor.
        index: Axis of a body's quantity, or position within a sensor.
        unit: SI.
    """

    name: str
    kind: str
    target: str
    quantity: str
    index: int
    unit: str

    @property
    def column(self) -> str:
        """The key in `channels`."""
        return self.name[:-2] if self.quantity == "orientation" else self.name


@dataclass(frozen=True)
class CommandTarget:
    """What a recorded command drives: an actuator, in `unit`, and the range that its command may have, if any."""

    actuator: str
    unit: str
    limits: tuple[float, float] | None


@dataclass(frozen=True)
class ForceColumns:
    """A recorded force on a body: columns of the force, and of its point (empty: the body's origin)."""

    body: str
    force: tuple[str, ...]
    point: tuple[str, ...]


@dataclass(frozen=True)
class OrientationColumns:
    """A measured orientation: the key in `channels`, and its columns w, x, y, z."""

    name: str
    columns: tuple[str, ...]


@dataclass(frozen=True)
class ModelMapping:
    """What `nominal.yaml` says of a mechanism.

    Args:
        commands: By column.
        forces: Recorded forces on bodies.
        sources: What each channel measures, C of them, in the order of the file.
        orientations: The orientations among them.
        noise: Stated standard deviation by channel.
        rests: Whether every episode starts at rest.
        known: Effects that are not the case.
    """

    commands: Mapping[str, CommandTarget]
    forces: tuple[ForceColumns, ...]
    sources: tuple[ChannelSource, ...]
    orientations: tuple[OrientationColumns, ...]
    noise: Mapping[str, float]
    rests: bool
    known: tuple[str, ...] = ()

    @property
    def driving(self) -> tuple[str, ...]:
        """Columns that drive the model."""
        return (*self.commands, *(c for f in self.forces for c in (*f.force, *f.point)))

    @property
    def columns(self) -> tuple[str, ...]:
        """All columns that are read."""
        measured = (s.name for s in self.sources if s.quantity != "orientation")
        return (*self.driving, *measured, *(c for o in self.orientations for c in o.columns))

    @property
    def units(self) -> Mapping[str, str]:
        """Of the columns that have one."""
        of = {s.name: s.unit for s in self.sources} | {n: c.unit for n, c in self.commands.items()}
        for f in self.forces:
            of |= dict.fromkeys(f.force, "N") | dict.fromkeys(f.point, "m")
        return of


def read_mapping(path: Path, content: Mapping, model: mujoco.MjModel) -> ModelMapping:
    """Return what the keys say, checked against the compiled model.

    Raises:
        RecordingError: Naming the file, the key, the value and what is allowed.
    """
    try:
        _check_keys("", content, KEYS)
        commands = {
            name: _command(f"commands.{name}", of, model) for name, of in _items("commands", content.get("commands"))
        }
        twice = [c.actuator for c in commands.values()]
        for name, command in commands.items():
            if twice.count(command.actuator) > 1:
                raise RecordingError(f"commands.{name}: actuator '{command.actuator}' is driven by two columns.")
        forces = _forces(content.get("forces"), model)
        if not content.get("channels"):
            raise RecordingError("channels: at least one column must be measured, got none.")
        sources, orientations = [], []
        for name, of in _items("channels", content["channels"]):
            sources += _channel(f"channels.{name}", name, of, model)
            if sources[-1].quantity == "orientation":
                orientations.append(OrientationColumns(name, _columns(f"channels.{name}.columns", of["columns"], 4)))
        start = content.get("start", "free")
        if start not in STARTS:
            raise RecordingError(f"start: unknown '{start}'. {nearest(str(start), STARTS)}")
        noise = _noise(content.get("noise"), sources)
        known = _known(content.get("known"))
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None
    return ModelMapping(commands, forces, tuple(sources), tuple(orientations), noise, start == "rest", known)


def _items(key: str, value: object) -> Iterator[tuple[str, Mapping]]:
    """Yield the entries of a mapping of mappings."""
    if value is None:
        return
    if not isinstance(value, Mapping):
        raise RecordingError(f"{key}: must hold `column: {{...}}` lines, got {value!r}.")
    for name, of in value.items():
        if not isinstance(of, Mapping):
            raise RecordingError(f"{key}.{name}: must be a mapping such as {{joint: NAME, ...}}, got {of!r}.")
        yield str(name), of


def _check_keys(prefix: str, content: Mapping, valid: tuple[str, ...]) -> None:
    for key in content:
        if key not in valid:
            raise RecordingError(f"unknown key '{prefix}{key}'. {nearest(str(key), valid)}")


def _named(key: str, kind: str, name: object, model: mujoco.MjModel) -> str:
    """Return a name if the model has such an element."""
    count = {
        "joint": model.njnt,
        "actuator": model.nu,
        "body": model.nbody,
        "sensor": model.nsensor,
    }[kind]
    names = [getattr(model, kind)(i).name for i in range(count)]
    if name not in names:
        hint = nearest(str(name), [n for n in names if n]) if any(names) else f"It has no {kind} at all."
        raise RecordingError(f"{key}: no {kind} '{name}' in the model. {hint}")
    return str(name)


def _command(key: str, of: Mapping, model: mujoco.MjModel) -> CommandTarget:
    _check_keys(f"{key}.", of, ("actuator",))
    name = _named(f"{key}.actuator", "actuator", of.get("actuator"), model)
    actuator = model.actuator(name)
    limited = bool(actuator.ctrllimited[0])
    limits = (float(actuator.ctrlrange[0]), float(actuator.ctrlrange[1])) if limited else None
    return CommandTarget(name, _command_unit(model, actuator.id), limits)


def is_servo(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator holds a position: its command is a target."""
    affine = int(model.actuator_biastype[actuator]) == AFFINE_BIAS
    return affine and float(model.actuator_biasprm[actuator, 1]) != 0.0


def _command_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Return the unit of an actuator's command where the model tells: a servo's target, a motor's force."""
    if int(model.actuator_trntype[actuator]) not in AT_JOINT:
        return ""
    hinge = int(model.jnt_type[model.actuator_trnid[actuator, 0]]) == HINGE
    if is_servo(model, actuator):
        return "rad" if hinge else "m"
    return ("N m" if hinge else "N") if gives_its_command(model, actuator) else ""


def gives_its_command(model: mujoco.MjModel, actuator: int) -> bool:
    """Whether an actuator's command is the force that it gives, in N or N m: by a gear it may be a current as well."""
    gains = (float(model.actuator_gainprm[actuator, 0]), float(model.actuator_gear[actuator, 0]))
    return int(model.actuator_biastype[actuator]) == NO_BIAS and gains == (1.0, 1.0)


def _forces(value: object, model: mujoco.MjModel) -> tuple[ForceColumns, ...]:
    if value is None:
        return ()
    if not isinstance(value, list):
        raise RecordingError(f"forces: must be a list of {{body, force, point}}, got {value!r}.")
    out = []
    for i, of in enumerate(value):
        key = f"forces[{i}]"
        if not isinstance(of, Mapping):
            raise RecordingError(f"{key}: must hold body, force and point, got {of!r}.")
        _check_keys(f"{key}.", of, ("body", "force", "point"))
        body = _named(f"{key}.body", "body", of.get("body"), model)
        point = _columns(f"{key}.point", of["point"], 3) if of.get("point") is not None else ()
        out.append(ForceColumns(body, _columns(f"{key}.force", of.get("force"), 3), point))
    return tuple(out)


def _columns(key: str, value: object, count: int) -> tuple[str, ...]:
    if not isinstance(value, list) or len(value) != count or not all(isinstance(v, str) for v in value):
        raise RecordingError(f"{key}: must be the names of {count} columns, got {value!r}.")
    return tuple(value)


def _channel(key: str, name: str, of: Mapping, model: mujoco.MjModel) -> list[ChannelSource]:
    """Return the channels that one entry stands for."""
    kinds = [kind for kind in (*QUANTITIES, "sensor") if kind in of]
    if len(kinds) != 1:
        raise RecordingError(f"{key}: must name one of 'joint', 'actuator', 'body', 'sensor', got {dict(of)!r}.")
    kind = kinds[0]
    target = _named(f"{key}.{kind}", kind, of[kind], model)
    if kind == "sensor":
        return [_sensor(key, name, target, of, model)]
    quantity = str(of.get("quantity"))
    if quantity not in QUANTITIES[kind]:
        raise RecordingError(f"{key}.quantity: unknown '{quantity}' of a {kind}. {nearest(quantity, QUANTITIES[kind])}")
    if kind == "joint":
        return [_joint(key, name, target, quantity, of, model)]
    if kind == "actuator":
        _check_keys(f"{key}.", of, ("actuator", "quantity"))
        return [ChannelSource(name, kind, target, quantity, 0, _force_unit(model, model.actuator(target).id))]
    if quantity == "orientation":
        _check_keys(f"{key}.", of, ("body", "quantity", "columns"))
        _columns(f"{key}.columns", of.get("columns"), 4)
        return [ChannelSource(f"{name}.{a}", kind, target, quantity, i, "rad") for i, a in enumerate(AXES)]
    _check_keys(f"{key}.", of, ("body", "quantity", "axis"))
    axis = of.get("axis")
    if axis not in AXES:
        raise RecordingError(f"{key}.axis: must be 'x', 'y' or 'z', got {axis!r}.")
    return [ChannelSource(name, kind, target, quantity, AXES.index(axis), BODY_UNITS[quantity])]


def _joint(key: str, name: str, target: str, quantity: str, of: Mapping, model: mujoco.MjModel) -> ChannelSource:
    _check_keys(f"{key}.", of, ("joint", "quantity"))
    unit = SCALAR_JOINTS.get(int(model.joint(target).type[0]))
    if unit is None:
        raise RecordingError(
            f"{key}.joint: '{target}' is a free or ball joint; allowed: hinge and slide. Give the body's position, "
            "orientation, velocity instead."
        )
    return ChannelSource(name, "joint", target, quantity, 0, unit + "/s" * (quantity == "velocity"))


def _force_unit(model: mujoco.MjModel, actuator: int) -> str:
    joint = int(model.actuator_trntype[actuator]) in AT_JOINT
    hinge = joint and int(model.jnt_type[model.actuator_trnid[actuator, 0]]) == HINGE
    return "N m" if hinge else "N"


def _sensor(key: str, name: str, target: str, of: Mapping, model: mujoco.MjModel) -> ChannelSource:
    _check_keys(f"{key}.", of, ("sensor", "index"))
    sensor = model.sensor(target)
    index, size = of.get("index", 0), int(sensor.dim[0])
    if isinstance(index, bool) or not isinstance(index, int) or not 0 <= index < size:
        raise RecordingError(f"{key}.index: must be an integer from 0 to {size - 1}, got {index!r}.")
    kind = mujoco.mjtSensor(int(sensor.type[0])).name.removeprefix("mjSENS_")
    return ChannelSource(name, "sensor", target, "sensor", index, SENSOR_UNITS.get(kind, ""))


def _known(value: object) -> tuple[str, ...]:
    if value is None:
        return ()
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise RecordingError(f"known: must be a list of effects, such as [gravity], got {value!r}.")
    return tuple(value)


def _noise(value: object, sources: list[ChannelSource]) -> dict[str, float]:
    """Return the stated noise by channel; of an orientation it is one number for its three."""
    if value is None:
        return {}
    if not isinstance(value, Mapping):
        raise RecordingError(f"noise: must be null or hold `channel: number` lines, got {value!r}.")
    names = dict.fromkeys(s.column for s in sources)
    _check_keys("noise.", value, tuple(names))
    out = {}
    for name, number in value.items():
        if number is None:
            continue
        try:
            level = float(number) if not isinstance(number, bool) else float("nan")
        except (TypeError, ValueError):
            level = float("nan")
        if not 0 < level < float("inf"):
            raise RecordingError(f"noise.{name}: must be a finite number > 0 or null, got {number!r}.")
        out |= {s.name: level for s in sources if s.column == name}
    return out
