"""What made a result: versions, the commit, and hashes of what it was made from."""

from __future__ import annotations

import functools
import hashlib
import json
import platform
import subprocess
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

from runner.errors import RecordingError
from runner.storage.limits import check_size

PACKAGE = Path(__file__).resolve().parents[1]
PACKAGES = ("runner", "mujoco", "dm-control", "numba", "numpy", "scipy", "pandas", "pyarrow", "rerun-sdk", "hydra-core")
HEX = 32  # digits of a hash that are kept: 128 bits


@functools.cache
def versions() -> Mapping[str, str]:
    """Return the versions that a result depends on."""
    return {"python": platform.python_version(), "machine": platform.platform()} | {p: _version(p) for p in PACKAGES}


def _version(package: str) -> str:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return "not installed"  # run from a checkout


@functools.cache
def commit() -> tuple[str | None, bool | None]:
    """Return the commit of the program and whether files differ from it; None, None where it is not under git."""
    # a package that lies in somebody else's working tree is not described by that tree's commit
    if _git("ls-files", "--error-unmatch", "__init__.py") is None:
        return None, None
    return _git("rev-parse", "HEAD"), bool(_git("status", "--porcelain", "."))


def _git(*arguments: str) -> str | None:
    """Return what git says in the package's folder, None without git or where it complains."""
    try:
        done = subprocess.run(["git", *arguments], cwd=PACKAGE, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return None
    return done.stdout.strip()


def program() -> dict[str, Any]:
    """Return what this program is: its versions, its commit and whether files differ from that."""
    sha, changed = commit()
    return {"versions": dict(versions()), "commit": sha, "changed": changed}


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return what differs between two programs, in words: `mujoco 3.16.0, now 3.17.0`."""
    old, new = before.get("versions") or {}, now.get("versions") or {}
    out = [f"{k} {old.get(k)}, now {new.get(k)}" for k in dict.fromkeys([*old, *new]) if old.get(k) != new.get(k)]
    if before.get("commit") != now.get("commit"):
        out.append(f"commit {str(before.get('commit'))[:10]}, now {str(now.get('commit'))[:10]}")
    return out


def in_a_row(program: Mapping[str, Any]) -> dict[str, Any]:
    """Return a program as columns of a table."""
    named = ", ".join(f"{name} {number}" for name, number in program["versions"].items() if name != "machine")
    sha = program["commit"] or ""
    return {"versions": named, "commit": f"{sha} and changes" if sha and program["changed"] else sha}


def digest(plain: Any) -> str:
    """Return a hash of plain data: the same for the same values, whatever the order of keys."""
    text = json.dumps(plain, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:HEX]


def files_digest(files: Iterable[tuple[str, Path]]) -> str:
    """Return a hash of the names and contents of files, in order.

    Raises:
        RecordingError: If one can't be read.
        LimitError: If one is too large.
    """
    whole = hashlib.sha256()
    for name, path in files:
        check_size(path)
        whole.update(f"{len(name)}:{name}".encode())
        try:
            with path.open("rb") as file:
                content = hashlib.file_digest(file, "sha256")
        except OSError as error:
            raise RecordingError(f"{path}: can't be read: {error.strerror}.") from None
        whole.update(content.digest())
    return whole.hexdigest()[:HEX]


def digests(files: Mapping[str, Path]) -> dict[str, str]:
    """Return a hash of each file by what it is for; what is not there is told where it is read.

    Raises:
        RecordingError: If one can't be read.
        LimitError: If one is too large.
    """
    return {name: files_digest([("", file)]) for name, file in files.items() if file.is_file()}
