"""What compiling kernels takes: a clock that leaves it out, a count, and who is told.

Numba is not loaded here: whoever only reads a clock needs no compiler.
"""

import contextlib
import gc
import logging
import threading
import time
from collections.abc import Iterator

# Python tells it on standard error where nobody has set up logging; programs hear of it by a
# handler of this logger.
_log = logging.getLogger("qsmooth")
MESSAGE = "compiling, first time only"
# Kernels that compile within so many seconds of each other are told of once.
PAUSE = 10.0


class _Compiling(threading.local):
    """What this Python thread compiles, and has compiled."""

    depth = 0
    started = 0.0
    seconds = 0.0
    ended = float("-inf")
    collects = False


_compiling = _Compiling()


class _Count:
    """Kernels compiled in this process, by any thread."""

    value = 0


def clock() -> float:
    """Seconds from some moment on, without what this Python thread spent compiling kernels."""
    return time.perf_counter() - _compiling.seconds


def compiled_kernels() -> int:
    """Count the kernels that this process had to compile, as no cache had them."""
    return _Count.value


def inside_another() -> bool:
    """Whether what compiles now is called by a kernel that began to compile before it."""
    return _compiling.depth > 1


@contextlib.contextmanager
def left_out() -> Iterator[None]:
    """Leave what is done inside the block out of the clock, as what belongs to compiling."""
    started = clock()
    try:
        yield
    finally:
        if not _compiling.depth:
            _compiling.seconds += clock() - started


def begin(of_ours: bool) -> bool:
    """Note that something begins to compile, maybe inside what compiles already.

    Returns
    -------
    bool
        Whether it is a kernel of ours.
    """
    if not _compiling.depth and not of_ours:
        return False
    _compiling.depth += 1
    if _compiling.depth > 1:
        return False
    _compiling.started = time.perf_counter()
    _Count.value += 1
    if _compiling.started > _compiling.ended + PAUSE:
        _log.warning(MESSAGE)
    # The compiler makes a million objects that stay: looking through them for garbage, again and
    # again, is a twentieth of its time.
    _compiling.collects = gc.isenabled()
    gc.disable()
    return True


def end() -> bool:
    """Note that it has compiled; say whether that was a kernel of ours."""
    if not _compiling.depth:
        return False
    _compiling.depth -= 1
    if _compiling.depth:
        return False
    _compiling.ended = time.perf_counter()
    _compiling.seconds += _compiling.ended - _compiling.started
    if _compiling.collects:
        gc.enable()
    return True
