"""Whole files: read at once, replaced at once."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import stat
import time
from collections.abc import Callable
from pathlib import Path

from qsmooth.errors import MeshError

# Seconds after which what was to become a file is nobody's any more.
LEFT_BEHIND = 3600.0


def read_bytes(path: Path) -> bytes:
    """All bytes of a file."""
    try:
        if stat.S_ISCHR(path.stat().st_mode) or stat.S_ISBLK(path.stat().st_mode):
            raise MeshError(f"cannot read '{path}': it is a device, which may never end")
        return path.read_bytes()
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        raise MeshError(f"cannot read '{path}': {reason(error)}") from error


def write_bytes(path: Path, data: bytes) -> None:
    """Replace the file of a mesh, or leave it whole: what fails half way leaves the old one."""
    try:
        replace_bytes(path, data)
    except (OSError, ValueError) as error:
        raise MeshError(f"cannot write '{path}': {reason(error)}") from error


def replace_bytes(path: Path, data: bytes) -> None:
    """Replace any file, or leave it whole.

    Raises
    ------
    OSError
        With the name of the file.
    """

    def fill(temporary: Path) -> None:
        # O_EXCL: never through a link somebody put there; 0o666: the umask decides.
        handle = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())

    try:
        if _is_special(path):
            with path.open("wb") as file:
                file.write(data)
        else:
            replace_file(path, fill)
    except OSError as error:
        raise OSError(error.errno, reason(error), str(path)) from error


def replace_file(path: Path, fill: Callable[[Path], None]) -> None:
    """Have `fill` make a file beside `path`, then put it in its place in one step."""
    target = Path(os.path.realpath(path))  # a link stays a link
    mode = None
    if target.exists():
        if target.is_dir():
            raise IsADirectoryError(21, "Is a directory")
        if not os.access(target, os.W_OK):
            raise PermissionError(13, "Permission denied")
        mode = stat.S_IMODE(target.stat().st_mode)
    _remove_left_behind(target)
    # With the same ending: there are writers that go by it.
    temporary = target.with_name(f"{_mark(target)}{secrets.token_hex(8)}{target.suffix}")
    try:
        fill(temporary)
        if mode is not None:
            temporary.chmod(mode)
        temporary.replace(target)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink()
        raise


def _mark(target: Path) -> str:
    """What the names begin with of files that are to become `target`, which may be long itself."""
    return f".qsmooth-{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:8]}-"


def _remove_left_behind(target: Path) -> None:
    """Remove what a process left that was killed while it wrote the same file.

    Others may be writing it just now, on other machines too: those are younger.
    """
    with contextlib.suppress(OSError):
        for path in target.parent.glob(f"{_mark(target)}*"):
            if path.stat().st_mtime < time.time() - LEFT_BEHIND:
                path.unlink()


def reason(error: Exception) -> str:
    """What the system says, without the error's number and file."""
    return getattr(error, "strerror", None) or str(error)


def _is_special(path: Path) -> bool:
    """Whether `path` is a pipe, a terminal or the like, which cannot be replaced."""
    if str(path).startswith(("/dev/", "/proc/")):
        return True
    return path.exists() and not path.is_file() and not path.is_dir()
