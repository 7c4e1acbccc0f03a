"""Read an MJCF that somebody else wrote: it may refer to files of its own folder alone, and must compile.

Compiling an MJCF loads the files that it names. Those outside of the case's folder are none of it, and plugins are
code; both are refused before anything is compiled.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree

import mujoco

from runner.errors import RecordingError

DIRECTORIES = ("meshdir", "texturedir", "assetdir")


@contextmanager
def quiet() -> Iterator[None]:
    """Keep MuJoCo from printing its warnings, and from writing them to a file in the working directory."""
    before, silent = mujoco.MjLogConfig.get(), mujoco.MjLogConfig.get()
    silent.logto_console = silent.logto_file = False
    silent.set()
    try:
        yield
    finally:
        before.set()


def read_mjcf(path: Path) -> mujoco.MjSpec:
    """Return the MJCF of a file, checked and compiled once.

    Joints, bodies and actuators without a name get one: `joint0`, `body2`, with their number in the model.

    Raises:
        RecordingError: If it can't be read, does not compile, needs a plugin or refers to a file outside of its folder.
    """
    _check(path, path.parent.resolve(), ())
    try:
        with quiet():
            spec = mujoco.MjSpec.from_file(str(path))
            spec.compile()
    except ValueError as error:
        raise RecordingError(f"{path}: is no model that MuJoCo compiles: {' '.join(str(error).split())}") from None
    for kind, elements in (("joint", spec.joints), ("body", spec.bodies), ("actuator", spec.actuators)):
        taken = {element.name for element in elements}
        for element in elements:
            if not element.name:
                element.name = next(n for n in _names(kind, element.id) if n not in taken)
                taken.add(element.name)
    spec.compile()
    return spec


def _names(kind: str, number: int) -> Iterator[str]:
    """Yield names for what has none."""
    name = f"{kind}{number}"
    while True:
        yield name
        name += "_"


def _check(path: Path, folder: Path, above: tuple[Path, ...]) -> None:
    """Refuse what a file, or a file that it includes, must not refer to."""
    if path in above:
        raise RecordingError(f"{path}: includes itself.")
    try:
        text = path.read_text(encoding="utf-8-sig")
        if "<!DOCTYPE" in text or "<!ENTITY" in text:
            raise RecordingError(f"{path}: must hold no document type and no entities.")
        root = ElementTree.fromstring(text)
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"{path}: can't be read: {error}.") from None
    except ElementTree.ParseError as error:
        raise RecordingError(f"{path}: is not valid XML: {error}.") from None
    for element in root.iter():
        tag = str(element.tag)
        if tag in ("extension", "plugin") or "plugin" in element.attrib:
            raise RecordingError(f"{path}: <{tag}> needs a plugin, which is code; allowed: MuJoCo's own elements.")
        for name, value in element.attrib.items():
            if name in DIRECTORIES or name.startswith("file"):
                inside = _inside(path, folder, f"<{tag} {name}>", value)
                # MuJoCo looks for included files in the folder of the first file
                if tag == "include" and inside.is_file():
                    _check(inside, folder, (*above, path))


def _inside(path: Path, folder: Path, where: str, value: str) -> Path:
    """Return the path that a value names, if it lies in the folder."""
    named = Path(value)
    full = (folder / named).resolve()
    foreign = "\\" in value or ":" in value
    if named.is_absolute() or ".." in named.parts or foreign or not full.is_relative_to(folder):
        raise RecordingError(
            f"{path}: {where}: must lie in the folder of the case (no absolute path, no '..'), got {value!r}."
        )
    return full
