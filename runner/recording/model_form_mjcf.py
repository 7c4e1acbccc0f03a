"""Read an MJCF that somebody else wrote: it may refer to files of its own folder alone, and must compile.

Compiling an MJCF loads the files that it names. Those outside of the case's folder are none of it, and plugins are
code; both are refused before anything is compiled.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from runner.errors import RecordingError
from runner.storage.limits import check_size

DIRECTORIES = ("meshdir", "texturedir", "assetdir")
COPYING, COUNTS = ("replicate", "composite", "flexcomp"), ("count", "cellcount")
COPIES, DEPTH = 10_000, 200
ALLOWED = f"allowed: {COPIES:,} in all."
MOST = 1_000_000_000  # bytes, or elements of what is counted
POWERS = {letter: 1024.0**k for k, letter in enumerate("KMGTPE", 1)}


@contextmanager
def quiet() -> Generator[None]:
    """Keep MuJoCo from printing its warnings, and from writing them to a file in the working directory.

    dm_control hands them to its own log once it is imported: one line for each step of a trial that has diverged.
    """
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    handler = mujoco.get_mju_user_warning()
    silent.set()
    mujoco.set_mju_user_warning(None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(handler)
        before.set()


def read_mjcf(path: Path) -> mujoco.MjSpec:
    """Return the MJCF of a file, checked and compiled once.

    Joints, bodies and actuators without a name get one: `joint0`, `body2`, with their number in the model. A free joint
    gets that of its body: it is the body that moves.

    Raises:
        RecordingError: If it can't be read, does not compile, needs a plugin or refers to a file outside of its folder.
    """
    _check(path)
    try:
        with quiet():
            spec = mujoco.MjSpec.from_file(str(path))
            spec.compile()
    except ValueError as error:
        raise RecordingError(f"{path}: is no model that MuJoCo compiles: {' '.join(str(error).split())}") from None
    for kind, elements in (("body", spec.bodies), ("joint", spec.joints), ("actuator", spec.actuators)):
        taken = {element.name for element in elements}
        for element in elements:
            if not element.name:
                free = isinstance(element, mujoco.MjsJoint) and element.type == mujoco.mjtJoint.mjJNT_FREE
                first = element.parent.name if free else f"{kind}{element.id}"
                element.name = next(n for n in _names(first) if n not in taken)
                taken.add(element.name)
    spec.compile()
    return spec


def referenced_files(path: Path) -> tuple[str, ...]:
    """Return the files that an MJCF names and that are there, relative to its folder, without the MJCF itself.

    Raises:
        RecordingError: If it can't be read, or refers to a file outside of its folder.
    """
    folder, seen = path.parent.resolve(), _check(path)
    found = {}
    for value in seen.files:
        for directory in seen.directories:
            inside = Path(directory) / value
            if (folder / inside).is_file():
                found[inside.as_posix()] = None
    return tuple(found)


def _names(name: str) -> Iterator[str]:
    """Yield names for what has none, the given one first."""
    while True:
        yield name
        name += "_"


@dataclass
class _Seen:
    """What has been read of an MJCF and of the files that it takes in.

    Args:
        read: Files, resolved.
        named: Attributes that name files or folders of them, and their values.
        folders: In which files may be looked for.
        attached: Copies that `<attach>` makes.
        attached_copies: The most copies of a part within a model that is attached.
    """

    read: set[Path] = field(default_factory=set)
    named: list[tuple[str, str]] = field(default_factory=list)
    folders: set[Path] = field(default_factory=set)
    attached: float = 0.0
    attached_copies: float = 1.0

    @property
    def directories(self) -> list[str]:
        """Where MuJoCo looks for meshes and textures, maybe: a compiler's setting may stand in any file."""
        return ["", *(value for name, value in self.named if name in DIRECTORIES)]

    @property
    def files(self) -> list[str]:
        """What is named as a file."""
        return [value for name, value in self.named if name not in DIRECTORIES]


def _check(path: Path) -> _Seen:
    """Refuse what a file, or one that it takes in, must not refer to or ask for."""
    folder, seen = path.parent.resolve(), _Seen()
    _check_file(path, folder, seen)
    if seen.attached * seen.attached_copies > COPIES:
        raise RecordingError(f"{path}: <attach> makes {seen.attached * seen.attached_copies:,.0f} copies, {ALLOWED}")
    for base in seen.folders:
        for directory in seen.directories:
            for value in seen.files:
                inside = _inside(path, folder, "a file", str(Path(directory) / value), base)
                if inside.is_file():
                    check_size(inside)
    return seen


def _check_file(
    path: Path, folder: Path, seen: _Seen, *, copies: float = 1.0, depth: int = 1, attached: bool = False
) -> None:
    """Look through one file, which stands for so many copies of it and so many levels deep in others."""
    if path.resolve() in seen.read:
        raise RecordingError(f"{path}: is included more than once, or includes itself.")
    seen.read.add(path.resolve())
    seen.folders |= {folder, path.parent.resolve()}
    todo = [(_root(path), copies, depth)]
    while todo:
        element, copies, depth = todo.pop()
        tag = str(element.tag)
        copies = _check_counts(path, element, copies, depth)
        if tag in ("extension", "plugin") or "plugin" in element.attrib:
            raise RecordingError(f"{path}: <{tag}> needs a plugin, which is code; allowed: MuJoCo's own elements.")
        if tag == "attach":
            seen.attached += copies
            if attached:
                raise RecordingError(f"{path}: <attach>: a model that is attached can attach no other.")
        if attached:
            seen.attached_copies = max(seen.attached_copies, copies)
        for name, value in element.attrib.items():
            if name in DIRECTORIES or name.startswith("file"):
                seen.named.append((name, value))
                places = {_inside(path, folder, f"<{tag} {name}>", value, base) for base in (folder, path.parent)}
                for place in sorted(places) if tag in ("include", "model") else ():
                    if place.is_file():
                        within = {"copies": copies} if tag == "include" else {}
                        _check_file(place, folder, seen, depth=depth + 1, attached=attached or tag == "model", **within)
        todo += [(child, copies, depth + 1) for child in element]


def _root(path: Path) -> ElementTree.Element:
    check_size(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise RecordingError(f"{path}: must hold no document type and no entities.")
        return ElementTree.fromstring(text)
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: can't be read: {error}.") from None
    except ElementTree.ParseError as error:
        raise RecordingError(f"{path}: is not valid XML: {error}.") from None


def _check_counts(path: Path, element: ElementTree.Element, copies: float, depth: int) -> float:
    """Refuse more copies than a mechanism has parts, and more memory than it needs; return the copies within."""
    tag = str(element.tag)
    if tag in COPYING:
        copies *= math.prod(_whole(element.get(name, "1")) for name in COUNTS)
    if copies > COPIES:
        raise RecordingError(f"{path}: <{tag}> makes {copies:,.0f} copies, {ALLOWED}")
    if depth > DEPTH:
        raise RecordingError(f"{path}: <{tag}> is nested deeper than {DEPTH} levels.")
    for name, value in element.attrib.items() if tag == "size" else ():
        if _amount(value) > MOST:
            raise RecordingError(f"{path}: <size {name}> sets aside {value}, allowed: at most {MOST:,}.")
    return copies


def _amount(text: str) -> float:
    """Return a number with MuJoCo's suffix (`2G`), 0 for what is none: MuJoCo refuses that."""
    power = POWERS.get(text.strip()[-1:].upper(), 1.0)
    try:
        return float(text.strip().rstrip("KMGTPEkmgtpe")) * power
    except ValueError:
        return 0.0


def _whole(text: str) -> float:
    """Return the product of numbers, 1 for what is none: MuJoCo refuses that."""
    try:
        return math.prod(max(float(part), 1.0) for part in text.split())
    except ValueError:
        return 1.0


def _inside(path: Path, folder: Path, where: str, value: str, base: Path) -> Path:
    """Return the path that a value names in a folder of files, if it lies in the case's folder."""
    named = Path(value)
    full = (base / named).resolve()
    foreign = "\\" in value or ":" in value
    if named.is_absolute() or ".." in named.parts or foreign or not full.is_relative_to(folder):
        raise RecordingError(
            f"{path}: {where}: must lie in the folder of the case (no absolute path, no '..'), got {value!r}."
        )
    return full
