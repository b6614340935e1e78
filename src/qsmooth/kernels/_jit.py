"""The compile flags of every kernel, set nowhere else, and the choice of threads."""

import functools
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FunctionType
from typing import Any, TypeVar, cast

import numba
from numba.core import event
from numba.core.compiler_lock import global_compiler_lock as _global_compiler_lock
from numba.extending import typeof_impl

from qsmooth.kernels import compiling
from qsmooth.kernels._caching import KernelCache
from qsmooth.kernels._linking import begin_linking, end_linking

F = TypeVar("F", bound=Callable[..., Any])

# Numba has type hints in some versions and none in others.
_njit: Any = numba.njit
_config: Any = numba.config
_compiler_lock: Any = _global_compiler_lock
_layer: Any = numba.threading_layer  # type: ignore[attr-defined, unused-ignore]
# Python's error model tests every division for zero and so stops vectorisation.
_COMMON = {"error_model": "numpy"}
_KERNEL = {**_COMMON, "nogil": True, "no_cfunc_wrapper": True}


class _Listener(event.Listener):
    """Passes on what Numba says of compiling; not of what it finds in its cache."""

    def on_start(self, event: Any) -> None:
        module = event.data["dispatcher"].py_func.__module__
        if compiling.begin(of_ours=module.startswith("qsmooth.")):
            begin_linking()

    def on_end(self, event: Any) -> None:
        if compiling.end():
            end_linking()


_register: Any = event.register
_register("numba:compile", _Listener())


class Helper:
    """A function that kernels call: compiled into them, with nothing that Python could call.

    What Numba wraps around a function so that Python and C can call it is a quarter of the compile
    time. Python gets a form of its own.
    """

    def __init__(self, function: FunctionType, **options: Any) -> None:
        functools.update_wrapper(self, function)
        self._function, self._options = function, {**_COMMON, **options}
        self.inside = _njit(no_cpython_wrapper=True, no_cfunc_wrapper=True, **self._options)(
            function
        )

    @functools.cached_property
    def _outside(self) -> Callable[..., Any]:
        return cast("Callable[..., Any]", _njit(**self._options)(self._function))

    def __call__(self, *args: Any) -> Any:
        return self._outside(*args)


@typeof_impl.register(Helper)
def _type_of_helper(helper: Helper, context: object) -> Any:
    return typeof_impl(helper.inside, context)


def _compiled(**options: Any) -> Callable[[F], F]:
    if _config.DISABLE_JIT:
        return lambda function: function
    return cast("Callable[[F], F]", functools.partial(Helper, **options))


def helper() -> Callable[[F], F]:
    """Compile a small function of scalars, which LLVM inlines into its kernels."""
    return _compiled()


def lane_helper() -> Callable[[F], F]:
    """Compile what a loop over lanes calls: always inlined, as a call stops vectorisation."""
    return _compiled(forceinline=True)


def inlined_helper() -> Callable[[F], F]:
    """Compile a step of one loop that takes arrays: always inlined, by LLVM.

    A call with arrays passes seven numbers and more for each, which LLVM does not reckon with: the
    Laplacian sweep is half as slow again with a call for the mean of a ring.
    """
    return _compiled(forceinline=True)


def strict_helper() -> Callable[[F], F]:
    """Compile what certifies validity: like `helper`, and never with fastmath.

    LLVM then neither reorders nor fuses the operations, as the error bounds assume.
    """
    return _compiled(fastmath=False)


def _kept(function: FunctionType, **options: Any) -> Any:
    """Compile a kernel when it is called, and keep it on disk."""
    made = _njit(**_KERNEL, **options)(function)
    if not _config.DISABLE_JIT:
        made._cache = KernelCache(function)
    return made


def kernel() -> Callable[[F], F]:
    """Compile a loop for one thread, cached on disk."""
    return cast("Callable[[F], F]", _kept)


class _Threads(threading.local):
    chosen = False


# Whether this Python thread has told Numba on how many threads parallel kernels run.
_threads = _Threads()


class _Pool:
    """Whether parallel regions may run in this process.

    GNU's OpenMP does not survive a fork: Numba ends a child that uses what its parent launched.
    """

    def __init__(self) -> None:
        # A pool that was there before may be the parent's too.
        self.inherited = multiprocessing.parent_process() is not None and self.layer == "omp"
        # Numba's workqueue ends the process where two Python threads run regions at a time.
        self.region = threading.Lock()
        if hasattr(os, "register_at_fork"):
            # A child of a fork while another thread compiles would wait for that thread for ever.
            os.register_at_fork(
                before=_compiler_lock.acquire,
                after_in_parent=_compiler_lock.release,
                after_in_child=self._after_fork,
            )

    def _after_fork(self) -> None:
        _compiler_lock.release()
        self.inherited = self.layer == "omp"
        self.region = threading.Lock()

    @property
    def layer(self) -> str:
        """Numba's threading layer; nothing before its first use."""
        try:
            return str(_layer())
        except ValueError:
            return ""

    @functools.cached_property
    def one_at_a_time(self) -> bool:
        """Whether only one Python thread may be in a parallel region; asked after the launch."""
        return self.layer == "workqueue"


_pool = _Pool()


@contextmanager
def use_threads(count: int) -> Iterator[None]:
    """Run parallel kernels on `count` threads inside the block (of this Python thread)."""
    chosen, before = _threads.chosen, numba.get_num_threads()
    numba.set_num_threads(count)
    _threads.chosen = True
    try:
        yield
    finally:
        numba.set_num_threads(before)
        _threads.chosen = chosen


def available_threads() -> int:
    """Count the threads that parallel kernels may use at most."""
    return int(_config.NUMBA_NUM_THREADS)


def useful_threads() -> int:
    """Count those of them that have a core: a process may be kept to fewer than it began with."""
    most = available_threads()
    if hasattr(os, "sched_getaffinity"):
        return min(most, len(os.sched_getaffinity(0)))
    return most


class ParallelKernel:
    """A loop over `prange`, compiled once for any number of threads.

    On one thread, which is what runs where `use_threads` says nothing, entering a parallel region
    costs a microsecond. A serial twin is compiled where no region can run: in a forked child under
    GNU's OpenMP, and beside another Python thread's under workqueue. Neither form has fastmath, so
    both give the same bits.
    """

    def __init__(self, function: FunctionType) -> None:
        functools.update_wrapper(self, function)
        self._function = function
        # Numba's cache tells functions apart by name, line and bytecode, not by flags: without a
        # name of its own the parallel form would be loaded where the serial one is wanted.
        twin = FunctionType(
            function.__code__, function.__globals__, function.__name__, function.__defaults__
        )
        twin.__module__ = function.__module__
        twin.__qualname__ = function.__qualname__ + "_parallel"
        self.parallel = _kept(twin, parallel=True)

    @functools.cached_property
    def serial(self) -> Callable[..., None]:
        """The plain loop."""
        return cast("Callable[..., None]", _kept(self._function))

    def __call__(self, *args: Any) -> None:
        if not _threads.chosen:
            with use_threads(1):
                self(*args)
        elif _pool.inherited:
            self.serial(*args)
        elif not _pool.one_at_a_time:
            self.parallel(*args)
        elif _pool.region.acquire(blocking=False):
            try:
                self.parallel(*args)
            finally:
                _pool.region.release()
        else:
            self.serial(*args)


def parallel_kernel() -> Callable[[F], F]:
    """Compile a loop over `prange`, which runs on as many threads as `use_threads` says."""
    return cast("Callable[[F], F]", ParallelKernel)
