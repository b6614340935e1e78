"""Engines: which colours are run, in which order, and on how many threads."""

import contextlib

import numba
import pytest

from qsmooth import engine
from qsmooth.engine import PARALLEL_FROM, SHARE, Quickest, Stepwise, Threads, threads_for
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


@pytest.mark.parametrize("one", [Threads(3), Stepwise(), Quickest(2)])
def test_nothing_to_run(one):
    calls = []
    one.run(calls.append, 0)
    assert [c for c in calls if c[0] < c[1]] == []


def test_the_threads_are_held_for_the_block_alone_and_given_back_after_an_error():
    ran, mine = [], numba.get_num_threads()
    kernel = parallel_kernel()(lambda: None)
    kernel.parallel = lambda: ran.append(numba.get_num_threads())
    kernel()
    for one in (Threads(2), Threads(1), Stepwise()):
        with contextlib.suppress(KeyError), one.running():
            kernel()
            raise KeyError
        kernel()
    # Outside an engine on one thread, whatever the caller has for kernels of his own.
    assert ran == [1, 2, 1, 1, 1, 1, 1]
    assert numba.get_num_threads() == mine


def test_the_count_of_threads_goes_by_size_unless_it_is_given(monkeypatch):
    monkeypatch.setattr(_jit, "available_threads", lambda: 4)
    monkeypatch.setattr(_jit.os, "sched_getaffinity", lambda _: range(8), raising=False)
    assert threads_for(None, PARALLEL_FROM).count == 4
    assert threads_for(3, 1).count == 3
    assert threads_for(1, 10**9).count == 1
    small = threads_for(None, 2 * SHARE - 1)
    assert (type(small), small.count) == (Threads, 1)
    between = [threads_for(None, n) for n in (2 * SHARE, 3 * SHARE, PARALLEL_FROM - 1)]
    assert [type(one) for one in between] == 3 * [Quickest]
    assert [one.others for one in between] == [2, 3, 4]
    with pytest.raises(ValueError, match="threads must be at most 4 here, got 5"):
        threads_for(5, 1)


def test_no_more_threads_than_cores_that_are_left_unless_they_are_asked_for(monkeypatch):
    monkeypatch.setattr(_jit, "available_threads", lambda: 4)
    monkeypatch.setattr(_jit.os, "sched_getaffinity", lambda _: {3}, raising=False)
    for n_movable in (1, 2 * SHARE, PARALLEL_FROM):
        one = threads_for(None, n_movable)
        assert (type(one), one.count) == (Threads, 1)
    assert threads_for(4, 1).count == 4


def swept(monkeypatch, n_sweeps, seconds):
    """Counts of threads that sweeps were run on; a sweep takes seconds(count, number)."""
    now, counts = [0.0], []
    monkeypatch.setattr(engine, "clock", lambda: now[0])

    def sweep(colours):
        assert colours == (0, 5)
        counts.append(numba.get_num_threads())
        now[0] += seconds(counts[-1], len(counts))

    quickest = Quickest(2)
    with quickest.running():
        for _ in range(n_sweeps):
            quickest.run(sweep, 5)
        assert numba.get_num_threads() == 1
    return counts, now[0]


def test_two_threads_are_kept_where_they_are_quicker(monkeypatch):
    counts, _ = swept(monkeypatch, 200, lambda count, _: 1.0 / count)
    assert counts[:5] == [1, 1, 2, 2, 2]
    assert counts.count(1) < 12


def test_a_second_thread_that_has_to_be_started_has_a_second_chance(monkeypatch):
    counts, _ = swept(monkeypatch, 100, lambda count, n: 1.02 if n == 3 else 1.0 / count)
    assert counts[:6] == [1, 1, 2, 2, 2, 2]


def test_where_a_second_thread_waits_for_a_core_little_time_is_lost(monkeypatch):
    counts, seconds = swept(monkeypatch, 1000, lambda count, _: 1.0 if count == 1 else 15.0)
    assert 2 in counts
    assert seconds < 1.07 * 1000


def test_the_choice_follows_the_machine(monkeypatch):
    def seconds(count, n):
        return 1.0 if count == 1 else 0.5 if n > 300 else 3.0

    counts, _ = swept(monkeypatch, 600, seconds)
    assert counts[200:300].count(2) <= 3
    assert counts[500:].count(2) > 90


def test_a_trial_that_was_quicker_by_chance_costs_a_sweep(monkeypatch):
    counts, _ = swept(
        monkeypatch, 60, lambda count, n: 0.9 if n == 3 else 1.0 if count == 1 else 15.0
    )
    assert counts[:6] == [1, 1, 2, 2, 1, 1]
