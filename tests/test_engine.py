"""Engines: which colours are run, in which order, and on how many threads."""

import contextlib

import numba
import pytest

from qsmooth.engine import PARALLEL_FROM, Stepwise, Threads, threads_for
from qsmooth.kernels import _jit
from qsmooth.kernels._jit import parallel_kernel

pytestmark = pytest.mark.nojit


def test_threads_run_all_colours_at_one_go():
    calls = []
    Threads(2).run(calls.append, 5)
    assert calls == [(0, 5)]


def test_stepwise_runs_a_colour_a_call_and_something_between():
    calls = []
    Stepwise(lambda colour: calls.append(f"after {colour}")).run(calls.append, 3)
    assert calls == [(0, 1), "after 0", (1, 2), "after 1", (2, 3), "after 2"]
    calls.clear()
    Stepwise().run(calls.append, 2)
    assert calls == [(0, 1), (1, 2)]


@pytest.mark.parametrize("engine", [Threads(3), Stepwise()])
def test_nothing_to_run(engine):
    calls = []
    engine.run(calls.append, 0)
    assert [c for c in calls if c[0] < c[1]] == []


def test_the_threads_are_held_for_the_block_alone_and_given_back_after_an_error():
    ran, mine = [], numba.get_num_threads()
    kernel = parallel_kernel()(lambda: None)
    kernel.parallel = lambda: ran.append(numba.get_num_threads())
    kernel()
    for engine in (Threads(2), Threads(1), Stepwise()):
        with contextlib.suppress(KeyError), engine.running():
            kernel()
            raise KeyError
        kernel()
    # Outside an engine on one thread, whatever the caller has for kernels of his own.
    assert ran == [1, 2, 1, 1, 1, 1, 1]
    assert numba.get_num_threads() == mine


def test_the_count_of_threads_goes_by_size_unless_it_is_given(monkeypatch):
    monkeypatch.setattr(_jit, "available_threads", lambda: 4)
    assert threads_for(None, PARALLEL_FROM - 1).count == 1
    assert threads_for(None, PARALLEL_FROM).count == 4
    assert threads_for(3, 1).count == 3
    assert threads_for(1, 10**9).count == 1
    with pytest.raises(ValueError, match="threads must be at most 4 here, got 5"):
        threads_for(5, 1)
