"""A fence that the kernel holds: it asks nobody which library, or which program, wants to open a file.

Landlock (Linux 5.13 and later) takes from a process, and from all that it starts, every right on files but those that
it names: https://docs.kernel.org/userspace-api/landlock.html. Where the kernel has none, a user namespace with a root
of its own shows the process those folders alone, see `user_namespaces(7)` and `pivot_root(2)`.

Landlock holds for the thread that asks for it and for what comes of that, a namespace is given to one thread only: so
this is called before numpy and its kind are imported, which start threads. Nothing but Python itself is imported here.
"""

from __future__ import annotations

import ctypes
import os
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from enum import StrEnum
from pathlib import Path

CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446  # the same numbers on all machines
PIVOT_ROOT = {"x86_64": 155, "aarch64": 41, "riscv64": 41}
ASK_VERSION, PATH_BENEATH, NO_NEW_PRIVILEGES = 1, 1, 38
# rights on files, by the version of Landlock that knows them (linux/landlock.h)
EXECUTE, WRITE_FILE, READ_FILE, READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
REFER, TRUNCATE, IOCTL_DEVICE = 1 << 13, 1 << 14, 1 << 15
FIRST = (1 << 13) - 1
LATER = {2: REFER, 3: TRUNCATE, 5: IOCTL_DEVICE}
CONNECT = 3  # binding and connecting TCP, from version 4 on
ALONE = 3  # no abstract sockets and no signals to those outside, from version 6 on
LOOK, EVERYTHING = READ_FILE | READ_DIR, -1
OF_A_FILE = EXECUTE | WRITE_FILE | READ_FILE | TRUNCATE | IOCTL_DEVICE
# libraries of the system, its list of them and of zones, fonts, what tells how many processors there are
SYSTEM = (
    "/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/share/zoneinfo", "/usr/share/fonts",
    "/etc/ld.so.cache", "/etc/localtime", "/dev/urandom", "/proc/cpuinfo", "/proc/meminfo", "/sys/devices/system/cpu",
)  # fmt: skip
NEW_NAMESPACES = 0x10000000 | 0x00020000  # user, mounts
BIND, REMOUNT, READ_ONLY, RECURSIVE, PRIVATE, DETACH = 4096, 32, 1, 16384, 1 << 18, 2


class Kept(StrEnum):
    """What keeps a process in."""

    landlock = "Landlock"
    namespace = "user namespace"
    hook = "audit hook"


class _Ruleset(ctypes.Structure):
    """`struct landlock_ruleset_attr`."""

    _fields_ = (("files", ctypes.c_uint64), ("net", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _Beneath(ctypes.Structure):
    """`struct landlock_path_beneath_attr`."""

    _pack_ = 1
    _fields_ = (("allowed", ctypes.c_uint64), ("parent", ctypes.c_int32))


class RefusedError(Exception):
    """The kernel has no such fence, or does not let this process have it."""


_in_force: Kept | None = None


def in_force() -> Kept | None:
    """Return which of the kernel's fences this process is behind; None: none."""
    return _in_force


def enter(writable: Sequence[Path], readable: Sequence[Path], means: Sequence[Kept] = tuple(Kept)) -> Kept:
    """Shut this process in, for good, by the first of some means that the kernel has.

    Args:
        writable: Folders in which everything is allowed.
        readable: Files and folders that may be read; those that are not there are passed over.
        means: What to try, in this order.

    Returns:
        What is in force; `Kept.hook`: nothing of the kernel's.
    """
    global _in_force
    rights = {Path(path).absolute(): LOOK for path in (*SYSTEM, *readable)}
    rights |= {Path(os.devnull): LOOK | WRITE_FILE} | {path.absolute(): EVERYTHING for path in writable}
    # under both names where one is a link, as a virtual environment is called by the link's
    there = {name: right for path, right in rights.items() if path.exists() for name in (path, path.resolve())}
    for kept in means:
        with suppress(RefusedError):
            ENTER[kept](there)
            _in_force = None if kept is Kept.hook else kept
            return kept
    return Kept.hook


def landlock_version() -> int:
    """Return the version of Landlock, 0 where there is none."""
    if sys.platform != "linux":
        return 0
    return max(0, _libc().syscall(CREATE_RULESET, None, ctypes.c_size_t(0), ASK_VERSION))


def _landlock(rights: Mapping[Path, int]) -> None:
    version = landlock_version()
    if version < 1 or not _is_one_thread():
        raise RefusedError
    try:
        _restrict(rights, version)
    except OSError as error:
        raise RefusedError from error


def _restrict(rights: Mapping[Path, int], version: int) -> None:
    known = FIRST | sum(right for since, right in LATER.items() if version >= since)
    wanted = _Ruleset(known, CONNECT if version >= 4 else 0, ALONE if version >= 6 else 0)
    # an older kernel knows a shorter structure
    size = 24 if version >= 6 else 16 if version >= 4 else 8
    ruleset = _called(_libc().syscall(CREATE_RULESET, ctypes.byref(wanted), ctypes.c_size_t(size), 0))
    try:
        for path, right in rights.items():
            allowed = known & (right if path.is_dir() else right & OF_A_FILE)
            handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
            try:
                rule = ctypes.byref(_Beneath(allowed, handle))
                _called(_libc().syscall(ADD_RULE, ruleset, PATH_BENEATH, rule, 0))
            finally:
                os.close(handle)
        _called(_libc().prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0))
        _called(_libc().syscall(RESTRICT_SELF, ruleset, 0))
    finally:
        os.close(ruleset)


def _namespace(rights: Mapping[Path, int]) -> None:
    """Make a root of memory, hang what is allowed into it, and go there; the old root is let go of."""
    if sys.platform != "linux" or platform.machine() not in PIVOT_ROOT or not _is_one_thread():
        raise RefusedError
    # tried in a process of its own: some systems give a namespace and then refuse every mount in it
    child = os.fork()
    if child == 0:
        ended = 1
        with suppress(OSError):
            _to_own_root(rights)
            ended = 0
        os._exit(ended)
    if os.waitpid(child, 0)[1] != 0:
        raise RefusedError
    _to_own_root(rights)


def _to_own_root(rights: Mapping[Path, int]) -> None:
    uid, gid, here = os.geteuid(), os.getegid(), Path.cwd()
    _called(_libc().unshare(NEW_NAMESPACES))
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"{uid} {uid} 1")
    Path("/proc/self/gid_map").write_text(f"{gid} {gid} 1")
    _mounted(None, "/", None, RECURSIVE | PRIVATE)
    root = next(path for path, right in rights.items() if right == EVERYTHING) / ".root"
    root.mkdir(exist_ok=True)
    _mounted("none", str(root), "tmpfs", 0)
    for path, right in sorted(rights.items()):
        place = root / path.relative_to("/")
        if place.exists() and right == LOOK:
            continue  # within a folder that hangs there already
        place.parent.mkdir(parents=True, exist_ok=True)
        if not place.exists():
            place.mkdir() if path.is_dir() else place.touch()
        _mounted(str(path), str(place), None, BIND if right == EVERYTHING else BIND | RECURSIVE)
        if right == LOOK:
            with suppress(OSError):  # what may not be changed outside stays as it is there: it can be read at any rate
                _mounted(None, str(place), None, BIND | REMOUNT | READ_ONLY)
    os.chdir(root)
    _called(_libc().syscall(PIVOT_ROOT[platform.machine()], b".", b"."))
    _called(_libc().umount2(b".", DETACH))
    os.chdir(here if here.is_dir() else "/")


def _is_one_thread() -> bool:
    return len(list(Path("/proc/self/task").iterdir())) == 1


def _mounted(source: str | None, target: str, kind: str | None, flags: int) -> None:
    words = [None if word is None else os.fsencode(word) for word in (source, target, kind)]
    _called(_libc().mount(*words, ctypes.c_ulong(flags), None))


def _called(returned: int) -> int:
    """Return what the kernel returned, or raise OSError."""
    if returned < 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
    return returned


def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _nothing(_: Mapping[Path, int]) -> None:
    return


ENTER: Mapping[Kept, Callable[[Mapping[Path, int]], None]] = {
    Kept.landlock: _landlock,
    Kept.namespace: _namespace,
    Kept.hook: _nothing,
}
