"""The compile flags of every kernel, set nowhere else, and the choice of threads."""

import functools
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any, TypeVar, cast

import numba

F = TypeVar("F", bound=Callable[..., Any])

# Numba has type hints in some versions and none in others.
_njit: Any = numba.njit
_config: Any = numba.config
# Python's error model tests every division for zero and so stops vectorisation.
_COMMON = {"error_model": "numpy"}
_KERNEL = {**_COMMON, "cache": True, "nogil": True}


def helper() -> Callable[[F], F]:
    """Compile a small function of scalars, which LLVM inlines into its kernels."""
    return cast("Callable[[F], F]", _njit(**_COMMON))


def lane_helper() -> Callable[[F], F]:
    """Compile what a loop over lanes calls: always inlined, as a call stops vectorisation."""
    return cast("Callable[[F], F]", _njit(forceinline=True, **_COMMON))


def inlined_helper() -> Callable[[F], F]:
    """Compile a step of one loop that takes arrays: always inlined, by LLVM.

    A call with arrays passes seven numbers and more for each, which LLVM does not reckon with: the
    Laplacian sweep is half as slow again with a call for the mean of a ring.
    """
    return cast("Callable[[F], F]", _njit(forceinline=True, **_COMMON))


def strict_helper() -> Callable[[F], F]:
    """Compile what certifies validity: like `helper`, and never with fastmath.

    LLVM then neither reorders nor fuses the operations, as the error bounds assume.
    """
    return cast("Callable[[F], F]", _njit(fastmath=False, **_COMMON))


def kernel() -> Callable[[F], F]:
    """Compile a loop for one thread, cached on disk."""
    return cast("Callable[[F], F]", _njit(**_KERNEL))


class _Threads(threading.local):
    count = 1


_threads = _Threads()


@contextmanager
def use_threads(count: int) -> Iterator[None]:
    """Run parallel kernels on `count` threads inside the block (of this Python thread)."""
    before = _threads.count
    _threads.count = count
    if count == 1:  # do not even start Numba's thread pool
        try:
            yield
        finally:
            _threads.count = before
        return
    pool_before = numba.get_num_threads()
    numba.set_num_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(pool_before)
        _threads.count = before


def available_threads() -> int:
    """Count the threads that parallel kernels may use at most."""
    return int(_config.NUMBA_NUM_THREADS)


class ParallelKernel:
    """One body compiled twice: a plain loop for one thread, a parallel one for several.

    Entering a parallel region costs 5 to 40 microseconds, and milliseconds on busy cores; a sweep
    of a small mesh is over before that. Neither form has fastmath, so both give the same bits.
    """

    def __init__(self, function: FunctionType) -> None:
        functools.update_wrapper(self, function)
        self.serial = _njit(**_KERNEL)(function)
        # Numba's cache tells functions apart by name, line and bytecode, not by flags: without a
        # name of its own the parallel form would be loaded where the serial one is wanted.
        twin = FunctionType(
            function.__code__, function.__globals__, function.__name__, function.__defaults__
        )
        twin.__module__ = function.__module__
        twin.__qualname__ = function.__qualname__ + "_parallel"
        self.parallel = _njit(parallel=True, **_KERNEL)(twin)

    def __call__(self, *args: Any) -> None:
        (self.serial if _threads.count == 1 else self.parallel)(*args)


def parallel_kernel() -> Callable[[F], F]:
    """Compile a loop over `prange` that runs on as many threads as `use_threads` says."""
    return cast("Callable[[F], F]", ParallelKernel)
