"""Whole files: read at once, replaced at once."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterator
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


@contextlib.contextmanager
def refused(what: str) -> Iterator[None]:
    """Make a MeshError of what a reader raises: files can be wrong in more ways than it checks."""
    try:
        yield
    except (MeshError, MemoryError):
        raise
    except Exception as error:
        raise MeshError(f"no valid {what} ({error!r})") from error


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


def write_folder(path: Path, files: dict[str, bytes], others: tuple[str, ...] = ()) -> None:
    """Write files that are one mesh, all or none of them.

    Where there is no folder yet, it is made beside and then put in its place. In one that is there
    a single file can be replaced in one step; several only where none is there, the first last.

    Parameters
    ----------
    path
        The folder; other files in it stay.
    files
        By name; the first is the one without which the folder has no mesh.
    others
        Names of files that would belong to the mesh if they were there.

    Raises
    ------
    MeshError
        If they cannot be written, or another mesh is in the folder.
    """
    try:
        _write_folder(Path(os.path.realpath(path)), files, others)
    except (OSError, ValueError) as error:
        raise MeshError(f"cannot write '{path}': {reason(error)}") from error


def _write_folder(target: Path, files: dict[str, bytes], others: tuple[str, ...]) -> None:
    if not target.exists():
        _remove_left_behind(target)
        temporary = target.with_name(f"{_mark(target)}{secrets.token_hex(8)}")
        temporary.mkdir()
        try:
            for name, data in files.items():
                replace_bytes(temporary / name, data)
            temporary.rename(target)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        return
    if not target.is_dir():
        raise NotADirectoryError(20, "It is a file, and the format takes a folder")
    there = [name for name in (*files, *others) if (target / name).exists()]
    differ = [n for n, data in files.items() if n not in there or read_bytes(target / n) != data]
    if there and (len(differ) > 1 or any(name not in files for name in there)):
        raise FileExistsError(
            17, "another mesh is in this folder, whose files cannot be replaced in one step"
        )
    written: list[Path] = []
    try:
        for name in reversed(differ):
            replace_bytes(target / name, files[name])
            written.append(target / name)
    except BaseException:
        if not there:
            for file in written:
                file.unlink()
        raise


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
                shutil.rmtree(path) if path.is_dir() else path.unlink()


def reason(error: Exception) -> str:
    """What the system says, without the error's number and file."""
    return getattr(error, "strerror", None) or str(error)


def _is_special(path: Path) -> bool:
    """Whether `path` is a pipe, a terminal or the like, which cannot be replaced."""
    if str(path).startswith(("/dev/", "/proc/")):
        return True
    return path.exists() and not path.is_file() and not path.is_dir()
