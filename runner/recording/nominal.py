"""Read and write `nominal.yaml`: what the owner of a recording believes.

half_size: 0.5        # m, of a cube; or [hx, hy, hz] of a box
mass: 3.0             # kg
friction: 0.3         # Coulomb, box on floor
gravity: 9.81         # m/s2
rate_hz: 60           # samples per second
contact: patch        # optional; patch: the load is spread over the base (default), corners: the corners carry it
noise:                # optional; standard deviations; null, as a whole or one by one: not known
  position: 0.0005    # m
  yaw: 0.001          # rad
  velocity: 0.005     # m/s
  rate: 0.01          # rad/s
com: [0, 0, 0]        # optional; m, relative to the geometric centre; two numbers: at mid-height
outline: {disc: 0.05} # optional; what lies on the floor is no rectangle, see `runner.recording.outline`
pin: {radius: 0.005, friction: 0.2, height: 0}   # optional; m, Coulomb, m: a round pin, see `runner.recording.table`
inertia: 0.5          # optional; kg m2, about the vertical through the centre of mass, or [Ixx, Iyy, Izz]
known: [mass]         # optional; effects that are not the case, as what they would change was measured
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, Field, StrictStr, ValidationError

from runner.errors import LimitError, RecordingError, nearest
from runner.recording.data import BelievedPin, Noise, Nominal, Support
from runner.recording.outline import check_outline, outline_of
from runner.storage.checked import dotted, must, refusal, refused
from runner.storage.reading import file_of
from runner.storage.writing import write_yaml
from runner.storage.yaml_text import YamlError, read_yaml

FILE = "nominal.yaml"
NOISE = {"position": "position_m", "yaw": "yaw_rad", "velocity": "velocity_m_s", "rate": "rate_rad_s"}
DENSITY_KG_M3 = (1e-2, 1e5)  # from below the lightest solids to above the heaviest
SYNONYMS = {"mu": "friction", "g": "gravity", "m": "mass", "size": "half_size", "fps": "rate_hz"}


def _no_truth(value: Any) -> Any:
    """Refuse true and false, which Python takes for numbers."""
    if isinstance(value, bool):
        raise ValueError
    return value


def _several(unit: str, *counts: int) -> BeforeValidator:
    """Return an annotation for a list of so many numbers; one number may stand by itself."""

    def check(value: Any) -> Any:
        items = value if isinstance(value, list) else [value]
        if len(items) not in counts:
            allowed = " or ".join(map(str, counts))
            raise refused(f"must be {allowed} numbers in {unit}, got {len(items)}: {value!r}.")
        return items

    return BeforeValidator(check)


# also numbers that YAML took for text (`1e-3`); their ranges are checked by `Nominal`
_Number = Annotated[float, Field(allow_inf_nan=False), BeforeValidator(_no_truth)]
_Pure = Annotated[_Number, must("be a finite number")]
_Metres = Annotated[_Number, must("be a finite number in m")]
_Moment = Annotated[_Number, must("be a finite number in kg m2")]


class _Noise(BaseModel, extra="forbid"):
    position: _Pure | None = None
    yaw: _Pure | None = None
    velocity: _Pure | None = None
    rate: _Pure | None = None


class _Pin(BaseModel, extra="forbid"):
    radius: _Metres
    friction: _Pure
    height: _Metres = 0.0


class _Believed(BaseModel, extra="forbid"):
    """The keys of `nominal.yaml`."""

    half_size: Annotated[list[_Metres], _several("m", 1, 3)]
    mass: Annotated[_Number, must("be a finite number in kg")]
    friction: _Pure
    gravity: Annotated[_Number, must("be a finite number in m/s2")]
    rate_hz: Annotated[_Number, must("be a finite number in Hz")]
    contact: Support = Support.PATCH
    noise: Annotated[_Noise, must(f"be null or hold {', '.join(map(repr, NOISE))}")] = _Noise()
    com: Annotated[list[_Metres], _several("m", 2, 3)] | None = None
    inertia: Annotated[list[_Moment], _several("kg m2", 1, 3)] | None = None
    outline: Any = None
    pin: Annotated[_Pin, must("hold 'radius' in m, 'friction' and perhaps 'height' in m")] | None = None
    known: Annotated[list[StrictStr], must("be a list of effects, such as [mass]")] = []


REQUIRED = tuple(name for name, field in _Believed.model_fields.items() if field.is_required())


def read_nominal(path: str | Path) -> Nominal:
    """Return what `nominal.yaml` says, checked.

    Args:
        path: The file, or the folder that holds it.

    Raises:
        RecordingError: If the file is missing or no YAML, a key is missing, unknown or given twice, or a value is no
            number, not possible, or hints at another unit. Numbers that YAML takes for text (`1e-3`) are numbers.
    """
    path = file_of(path, FILE)
    content = load_mapping(path, REQUIRED)
    try:
        return nominal_of(content, path)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


def outline_file(folder: Path) -> Path | None:
    """Return the table that `nominal.yaml` takes an outline from; None where it takes none, or can't be read."""
    try:
        content = read_yaml(folder / FILE)
    except (YamlError, LimitError):
        return None
    named = content.get("outline") if isinstance(content, Mapping) else None
    return folder / Path(named.partition("#")[0]).name if isinstance(named, str) else None


def write_nominal(nominal: Nominal, path: str | Path) -> None:
    """Write `nominal.yaml` (to a file of that path) so that reading it gives the same values."""
    size, noise = nominal.half_size_m, nominal.noise
    content: dict[str, object] = {
        "half_size": float(size[0]) if len(set(size)) == 1 else [float(h) for h in size],
        "mass": float(nominal.mass_kg),
        "friction": float(nominal.friction),
        "gravity": float(nominal.gravity_m_s2),
        "contact": nominal.contact.value,
        "rate_hz": float(nominal.rate_hz),
        "noise": _plain(noise) if noise != Noise() else None,
    }
    if nominal.com_m is not None:
        content["com"] = [float(c) for c in nominal.com_m]
    if nominal.inertia_kg_m2 is not None:
        inertia = nominal.inertia_kg_m2
        content["inertia"] = [float(i) for i in inertia] if isinstance(inertia, tuple) else float(inertia)
    if nominal.outline is not None:
        content["outline"] = [list(point) for point in nominal.outline.points]
    if nominal.pin is not None:
        pin = nominal.pin
        content["pin"] = {"radius": float(pin.radius_m), "friction": float(pin.friction), "height": float(pin.height_m)}
    if nominal.known:
        content["known"] = list(nominal.known)
    write_yaml(Path(path), content)


def load_mapping(path: Path, needed: Iterable[str]) -> Mapping:
    """Return the mapping of a YAML file, whatever its keys; those that are needed are named where there is none.

    Raises:
        RecordingError: If the file is missing, no YAML, no mapping, or gives a key twice.
    """
    if not path.is_file():
        raise RecordingError(
            f"{path}: no such file; a case needs a {FILE} with {_listed(needed)}. Of a log `runner import` makes one."
        )
    try:
        content = read_yaml(path)
    except YamlError as error:
        raise RecordingError(f"{path}:{error}") from None
    if content is None:
        raise RecordingError(f"{path}: is empty; it needs {_listed(needed)}.")
    if not isinstance(content, Mapping):
        raise RecordingError(f"{path}: must hold `key: value` lines, got a {type(content).__name__}.")
    return content


def nominal_of(content: Mapping, path: Path) -> Nominal:
    """Return what the content of a `nominal.yaml` says, checked; its messages do not name the file.

    Args:
        content: Of the file.
        path: The file, beside which a table of outlines lies.

    Raises:
        RecordingError: As `read_nominal` does.
    """
    try:
        believed = _Believed.model_validate({str(key): value for key, value in content.items() if value is not None})
    except ValidationError as error:
        raise _refused(error, content) from None
    sizes, inertia = believed.half_size, believed.inertia
    nominal = Nominal(
        half_size_m=_triple(sizes * 3 if len(sizes) == 1 else sizes),
        mass_kg=believed.mass,
        friction=believed.friction,
        gravity_m_s2=believed.gravity,
        rate_hz=believed.rate_hz,
        contact=believed.contact,
        noise=Noise(**{field: getattr(believed.noise, key) for key, field in NOISE.items()}),
        com_m=None if believed.com is None else _triple([*believed.com, 0.0][:3]),
        inertia_kg_m2=None if inertia is None else inertia[0] if len(inertia) == 1 else _triple(inertia),
        outline=None if believed.outline is None else outline_of(believed.outline, path.parent),
        pin=None
        if believed.pin is None
        else BelievedPin(believed.pin.radius, believed.pin.friction, believed.pin.height),
        known=tuple(believed.known),
        path=path,
    )
    _check_units(nominal)
    return nominal


def _refused(error: ValidationError, content: Mapping) -> RecordingError:
    """Return what is wrong: a key that is not known before one that is missing, as it may be meant for it."""
    places = {kind: [e["loc"] for e in error.errors() if e["type"] == kind] for kind in ("extra_forbidden", "missing")}
    for place in places["extra_forbidden"][:1]:
        within = {"noise": _Noise, "pin": _Pin}.get(str(place[0]), _Noise)
        name, valid = str(place[-1]), (_Believed if len(place) == 1 else within).model_fields
        text, synonym = nearest(name, valid), SYNONYMS.get(name.lower())
        hint = f" Did you mean '{synonym}'?" if synonym in valid and "Did you mean" not in text else ""
        return RecordingError(f"unknown key '{dotted(place)}'. {text}{hint}")
    if missing := places["missing"]:
        inside = all(len(place) > 1 for place in missing)
        needed = [f"pin.{name}" for name in _Pin.model_fields] if inside else REQUIRED
        return RecordingError(f"missing {_listed(map(dotted, missing))}; needed: {_listed(needed)}.")
    place, text = refusal(error)
    alone = not isinstance(content.get(place[0]), list | Mapping)
    return RecordingError(f"{dotted(place[:1] if alone else place)}: {text}")


def _check_units(nominal: Nominal) -> None:
    """Refuse a density that no solid has and an inertia that no mass inside the box has: another unit."""
    if nominal.outline is not None:
        if nominal.contact is not Support.PATCH:
            raise RecordingError("contact: the load of a body with an `outline` is spread over its base: 'patch'.")
        check_outline(nominal.outline, nominal.half_size_m)
    hx, hy, hz = nominal.half_size_m
    density = nominal.mass_kg / nominal.volume_m3
    least, most = DENSITY_KG_M3
    if not least <= density <= most:
        cause = "half_size in mm" if density < least else "mass in g, or half_size is that of something else"
        raise RecordingError(
            f"half_size, mass: {[hx, hy, hz]} m and {nominal.mass_kg:g} kg make {density:.3g} kg/m3, allowed: "
            f"{least:g} to {most:g}; probably {cause}."
        )
    widest = nominal.mass_kg * (hx**2 + hy**2)
    if nominal.yaw_inertia_kg_m2 > 3 * widest:
        raise RecordingError(
            f"inertia: {nominal.yaw_inertia_kg_m2:g} kg m2 about z can't be: {nominal.mass_kg:g} kg inside this box "
            f"has at most {widest:.3g}; probably not in kg m2."
        )


def _plain(noise: Noise) -> dict[str, float | None]:
    values = {key: getattr(noise, field) for key, field in NOISE.items()}
    return {key: None if value is None else float(value) for key, value in values.items()}


def _triple(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
