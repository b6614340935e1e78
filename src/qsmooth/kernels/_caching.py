"""Where compiled kernels are kept: in Numba's cache, or nowhere where that cannot be.

Numba looks for a folder as soon as a function is made, and raises where none can be written, as in
a read-only installation without a home; nor does it outlive a disk that is full. Here a kernel
looks for its folder when it is first called, and what cannot be kept is compiled and used all the
same.
"""

import functools
import logging
from pathlib import Path
from types import FunctionType
from typing import Any

from numba.core import caching
from numba.core.runtime import nrt

from qsmooth.kernels import compiling

_log = logging.getLogger("qsmooth")
MESSAGE = (
    "compiled kernels cannot be kept, so that each process compiles them anew: {}; set "
    "NUMBA_CACHE_DIR to a folder that can be written"
)
_UserWide: Any = caching.UserWideCacheLocator
_Implementation: Any = caching.CompileResultCacheImpl
_FunctionCache: Any = caching.FunctionCache
_Null: Any = caching.NullCache
_Cache: Any = caching._Cache
_memory: Any = nrt.rtsys  # of arrays that kernels make


class _InAHome(_UserWide):  # type: ignore[misc]
    """The user's folder for caches; without a home Numba makes a folder called "~" anywhere."""

    def ensure_cache_path(self) -> None:
        if not Path(self.get_cache_path()).is_absolute():
            raise FileNotFoundError
        super().ensure_cache_path()


class _Folders(_Implementation):  # type: ignore[misc]
    _locator_classes = tuple(
        _InAHome if known is _UserWide else known for known in _Implementation._locator_classes
    )


class _Kept(_FunctionCache):  # type: ignore[misc]
    _impl_class = _Folders

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Get a compiled form.

        What compiling needs, half a second of imports, is left to the first kernel that is
        compiled: Numba asks for it then, too.
        """
        _memory.initialize(target_context)
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class _Told:
    """Whether this process has said that nothing is kept."""

    value = False


def _tell(why: object) -> None:
    if not _Told.value:
        _Told.value = True
        _log.warning(MESSAGE.format(why))


class KernelCache(_Cache):  # type: ignore[misc]
    """A kernel's cache on disk, which never fails: what it cannot do it tells once a process.

    Parameters
    ----------
    function
        The kernel in Python.
    """

    def __init__(self, function: FunctionType) -> None:
        self._function = function

    @functools.cached_property
    def _kept(self) -> Any:
        try:
            return _Kept(self._function)
        except (OSError, RuntimeError):
            _tell("no folder for them can be written")
            return _Null()

    @property
    def cache_path(self) -> Any:
        """The folder, or None."""
        return self._kept.cache_path

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Get a compiled form, or None where it is not there or cannot be read."""
        with compiling.left_out():
            try:
                return self._kept.load_overload(sig, target_context)
            except Exception:  # whatever a damaged file makes of itself: it is written anew
                self.flush()
                return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a compiled form."""
        with compiling.left_out():
            try:
                self._kept.save_overload(sig, data)
            except OSError as error:
                _tell(error)

    def enable(self) -> None:
        """Use what is kept."""
        self._kept.enable()

    def disable(self) -> None:
        """Use nothing of it."""
        self._kept.disable()

    def flush(self) -> None:
        """Forget what is kept."""
        try:
            self._kept.flush()
        except OSError as error:
            _tell(error)
