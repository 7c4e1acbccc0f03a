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
inertia: 0.5          # optional; kg m2, about the vertical through the centre of mass, or [Ixx, Iyy, Izz]
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import yaml

from runner.errors import RecordingError, nearest
from runner.recording.data import Contact, Noise, Nominal

FILE = "nominal.yaml"
REQUIRED = ("half_size", "mass", "friction", "gravity", "rate_hz")
OPTIONAL = ("contact", "noise", "com", "inertia")
NOISE = {"position": "position_m", "yaw": "yaw_rad", "velocity": "velocity_m_s", "rate": "rate_rad_s"}
DENSITY_KG_M3 = (1e-2, 1e5)  # from below the lightest solids to above the heaviest
SYNONYMS = {"mu": "friction", "g": "gravity", "m": "mass", "size": "half_size", "fps": "rate_hz"}


def read_nominal(path: str | Path) -> Nominal:
    """Return what `nominal.yaml` says, checked.

    Args:
        path: The file, or the folder that holds it.

    Raises:
        RecordingError: If the file is missing or no YAML, a key is missing, unknown or given twice, or a value is no
            number, not possible, or hints at another unit. Numbers that YAML takes for text (`1e-3`) are numbers.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    content = load_mapping(path, REQUIRED)
    try:
        return _nominal(content, path)
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from None


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
    Path(path).write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


class _Loader(yaml.SafeLoader):
    """Safe YAML that refuses a key given twice, of which plain YAML silently takes the last."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        keys = [self.construct_object(key, deep=True) for key, _ in node.value]
        for k, (key_node, _) in enumerate(node.value):
            if keys[k] in keys[:k]:
                raise yaml.MarkedYAMLError(problem=f"key '{keys[k]}' is given twice", problem_mark=key_node.start_mark)
        return super().construct_mapping(node, deep=deep)


def load_mapping(path: Path, needed: Iterable[str]) -> Mapping:
    """Return the mapping of a YAML file, whatever its keys; those that are needed are named where there is none.

    Raises:
        RecordingError: If the file is missing, no YAML, no mapping, or gives a key twice.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: no such file; a case needs a {FILE} with {_listed(needed)}.")
    try:
        content = yaml.load(path.read_text(encoding="utf-8-sig"), _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        place = f" line {mark.line + 1}, column {mark.column + 1}:" if mark else ""
        raise RecordingError(f"{path}:{place} not valid YAML: {error.problem}.") from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: not valid YAML: {' '.join(str(error).split())}.") from None
    except OSError as error:
        raise RecordingError(f"{path}: can't be read: {error.strerror}.") from None
    if content is None:
        raise RecordingError(f"{path}: is empty; it needs {_listed(needed)}.")
    if not isinstance(content, Mapping):
        raise RecordingError(f"{path}: must hold `key: value` lines, got a {type(content).__name__}.")
    return content


def _nominal(content: Mapping, path: Path) -> Nominal:
    _check_keys("", content, (*REQUIRED, *OPTIONAL))
    missing = [key for key in REQUIRED if content.get(key) is None]
    if missing:
        raise RecordingError(f"missing {_listed(missing)}; needed: {_listed(REQUIRED)}.")
    sizes = _numbers("half_size", content["half_size"], "m", (1, 3))
    com = None if content.get("com") is None else _numbers("com", content["com"], "m", (2, 3))
    inertia = None if content.get("inertia") is None else _numbers("inertia", content["inertia"], "kg m2", (1, 3))
    nominal = Nominal(
        half_size_m=_triple(sizes * 3 if len(sizes) == 1 else sizes),
        mass_kg=_number("mass", content["mass"], "kg"),
        friction=_number("friction", content["friction"], ""),
        gravity_m_s2=_number("gravity", content["gravity"], "m/s2"),
        rate_hz=_number("rate_hz", content["rate_hz"], "Hz"),
        contact=_contact(content.get("contact")),
        noise=_noise(content.get("noise")),
        com_m=None if com is None else _triple([*com, 0.0][:3]),
        inertia_kg_m2=None if inertia is None else inertia[0] if len(inertia) == 1 else _triple(inertia),
        path=path,
    )
    _check_units(nominal)
    return nominal


def _check_units(nominal: Nominal) -> None:
    """Refuse a density that no solid has and an inertia that no mass inside the box has: another unit."""
    hx, hy, hz = nominal.half_size_m
    density = nominal.mass_kg / (8 * hx * hy * hz)
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


def _check_keys(prefix: str, content: Mapping, valid: Iterable[str]) -> None:
    valid = tuple(valid)
    for key in content:
        if key not in valid:
            synonym = SYNONYMS.get(str(key).lower())
            hint = f" Did you mean '{synonym}'?" if synonym in valid else ""
            text = nearest(str(key), valid)
            raise RecordingError(f"unknown key '{prefix}{key}'. {text}{'' if 'Did you mean' in text else hint}")


def _contact(value: object) -> Contact:
    names = [c.value for c in Contact]
    if value is None:
        return Contact.PATCH
    if value not in names:
        raise RecordingError(f"contact: unknown '{value}'. {nearest(str(value), names)}")
    return Contact(value)


def _noise(value: object) -> Noise:
    if value is None:
        return Noise()
    if not isinstance(value, Mapping):
        raise RecordingError(f"noise: must be null or hold {_listed(NOISE)}, got {value!r}.")
    _check_keys("noise.", value, NOISE)
    given = {key: number for key, number in value.items() if number is not None}
    return Noise(**{NOISE[key]: _number(f"noise.{key}", number, "") for key, number in given.items()})


def _number(key: str, value: object, unit: str) -> float:
    """Return a number, also one that YAML took for text (`1e-3`); its range is checked by whom it is given to."""
    try:
        number = math.nan if isinstance(value, bool) or not isinstance(value, (int, float, str)) else float(value)
    except (ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise RecordingError(f"{key}: must be a finite number{' in ' + unit if unit else ''}, got {value!r}.")
    return number


def _numbers(key: str, value: object, unit: str, lengths: tuple[int, ...]) -> list[float]:
    items = value if isinstance(value, list) else [value]
    if len(items) not in lengths:
        allowed = " or ".join(map(str, lengths))
        raise RecordingError(f"{key}: must be {allowed} numbers in {unit}, got {len(items)}: {value!r}.")
    return [_number(key if len(items) == 1 else f"{key}[{i}]", item, unit) for i, item in enumerate(items)]


def _plain(noise: Noise) -> dict[str, float | None]:
    values = {key: getattr(noise, field) for key, field in NOISE.items()}
    return {key: None if value is None else float(value) for key, value in values.items()}


def _triple(values: list[float]) -> tuple[float, float, float]:
    x, y, z = values
    return x, y, z


def _listed(names: Iterable[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
