"""The ways in: smooth, untangle, compare; names, options and what each refuses."""

import math
import re
import sys

import numpy as np
import pytest

from meshes import annulus, grid, random_mesh, tangle
from qsmooth import (
    Angle,
    Laplacian,
    Mesh,
    MeshError,
    Optimize,
    Star,
    Stop,
    Untangle,
    compare,
    quality,
    smooth,
    untangle,
)
from qsmooth.examples import bump
from qsmooth.numbering import numbered
from qsmooth.registry import all_methods, methods
from qsmooth.topology import Topology

pytestmark = pytest.mark.nojit

every_method = pytest.mark.parametrize("known", all_methods().values(), ids=all_methods())


def rough(kind="mixed", size=4, seed=1):
    return random_mesh(kind, size, seed=seed, amount=0.9).mesh


# ------------------------------------------------------------------------------- smooth


@pytest.mark.parametrize("known", methods().values(), ids=methods())
def test_a_name_with_options_and_a_method_with_its_own_are_the_same_call(known):
    mesh = rough()
    results = [
        smooth(mesh, known.name, max_sweeps=3),
        smooth(mesh, known(max_sweeps=3)),
        smooth((mesh.points, mesh.cells), known.name, max_sweeps=np.int64(3)),
        smooth((mesh.points.tolist(), [b.tolist() for b in mesh.cells]), known(max_sweeps=3)),
    ]
    for result in results:
        assert result.method == known.name
        assert result.points.tobytes() == results[0].points.tobytes()
        assert result.history == results[0].history
        assert result.outcome == results[0].outcome


def test_values_come_as_any_number_type_and_give_the_same_bits():
    mesh = rough()
    for plain, other in (({"step": 1.0}, {"step": 1}), ({"rtol": 0.5}, {"rtol": np.float32(0.5)})):
        one, two = (smooth(mesh, "star", max_sweeps=3, **options) for options in (plain, other))
        assert one.points.tobytes() == two.points.tobytes()


def test_options_beside_a_method_that_has_its_own():
    with pytest.raises(TypeError, match=r"^options go into Star\(...\), not beside it: step, rtol"):
        smooth(grid(2, 2), Star(), step=0.5, rtol=0.0)
    with pytest.raises(TypeError, match=r"^options go into Optimize\(...\)"):
        smooth(grid(2, 2), Optimize(), max_sweeps=5000)


@pytest.mark.parametrize(
    ("method", "options", "message"),
    [
        ("laplacian", {"guard": "clearance"}, "method 'laplacian' has no option 'guard'"),
        ("star", {"stepp": 0.25}, "method 'star' has no option 'stepp'; did you mean 'step'?"),
        ("star", {"max_sweep": 3}, "has no option 'max_sweep'; did you mean 'max_sweeps'?"),
        ("optimize", {"rtol": 0.1}, "method 'optimize' has no option 'rtol'"),
        ("auto", {"max_angle": 110.0}, "method 'optimize' has no option 'max_angle'"),
        ("auto", {"split_quads": True, "worst": True}, "method 'aspect-ratio' has no option"),
    ],
)
def test_an_option_that_the_method_does_not_have(method, options, message):
    with pytest.raises(TypeError, match=f"{re.escape(message)}"):
        smooth(grid(2, 2), method, **options)


@every_method
def test_no_method_has_an_option_of_another_without_saying_so(known):
    # Each name of any method that this one does not have is refused; a value need not be looked at.
    others = {name for m in all_methods().values() for name in m.specs()} - known.specs().keys()
    for name in others:
        with pytest.raises(TypeError, match=f"^method '{known.name}' has no option '{name}'"):
            known.of({name: object()})


def test_a_method_that_is_none():
    with pytest.raises(ValueError, match=r"^method must be one of auto, optimize, .*; got 'fast'"):
        smooth(grid(2, 2), "fast")
    with pytest.raises(ValueError, match="did you mean 'laplacian'"):
        smooth(grid(2, 2), "laplacien")
    with pytest.raises(ValueError, match="method must be one of"):
        smooth(grid(2, 2), Star)


def test_what_is_no_mesh():
    for run in (smooth, untangle, compare):
        with pytest.raises(TypeError, match="str"):
            run("mesh.off")
        with pytest.raises(MeshError):
            run(([(0, 0), (1, 0)], [(0, 1, 2)]))


@every_method
def test_options_out_of_range_are_named(known):
    for options, message in (
        ({"max_sweeps": -1}, "max_sweeps must be an integer of 0 or more, got -1"),
        ({"max_sweeps": 1.5}, "max_sweeps must be an integer of 0 or more, got 1.5"),
        ({"time_limit": 0.0}, "time_limit must be over 0 seconds, got 0.0"),
        ({"time_limit": math.nan}, "time_limit must be over 0 seconds, got nan"),
        ({"threads": 0}, "threads must be an integer of 1 or more, got 0"),
        ({"threads": True}, "threads must be an integer of 1 or more, got True"),
        ({"selection_rings": -1}, "selection_rings must be an integer of 0 or more, got -1"),
        ({"keep_interfaces": 1}, "keep_interfaces must be True or False, got 1"),
    ):
        with pytest.raises(ValueError, match=f"^{re.escape(message)}"):
            known.of(options)
    with pytest.raises(ValueError, match=r"^threads must be at most \d+ here, got 1000000"):
        smooth(rough(), known(threads=10**6))


# ------------------------------------------------------------------------------- auto


@pytest.mark.parametrize("kind", ["quads", "mixed", "triangles"])
def test_auto_means_optimize(kind):
    mesh = rough(kind, 3)
    auto, named, unnamed = (
        smooth(mesh, *method, max_sweeps=5) for method in (("auto",), ("optimize",), ())
    )
    assert auto.method == named.method == unnamed.method == "optimize"
    assert auto.points.tobytes() == named.points.tobytes() == unnamed.points.tobytes()
    assert auto.outcome == unnamed.outcome == named.outcome
    assert "auto" not in named.reason


def test_auto_takes_the_triangle_method_for_quads_that_are_cut():
    mesh = rough("quads")
    result = smooth(mesh, split_quads=True, max_sweeps=1)
    assert result.method == "aspect-ratio"
    assert result.outcome.chosen
    assert result.reason.startswith("auto chose aspect-ratio, as the quads are cut in triangles")


# ------------------------------------------------------------------------------- results


@every_method
def test_the_input_stays_and_the_result_has_both_summaries(known):
    mesh = rough()
    points = mesh.points.copy()
    result = smooth(mesh, known(max_sweeps=10))
    assert mesh.points.tobytes() == points.tobytes()
    assert result.before == quality(mesh).summary()
    assert result.after == quality(result.mesh).summary()
    assert result.mesh.topology is mesh.topology
    assert all(np.array_equal(a, b) for a, b in zip(result.mesh.cells, mesh.cells, strict=True))
    assert result.seconds >= 0.0


@every_method
def test_no_sweep(known):
    mesh = rough()
    result = smooth(mesh, known(max_sweeps=0))
    assert (result.sweeps, result.history) == (0, ())
    assert result.outcome.unchanged
    assert np.array_equal(result.points, mesh.points)
    # Untangling has nothing to do here and is done; the others were not let to.
    assert result.outcome.stop is (Stop.VALID if known is Untangle else Stop.MAX_SWEEPS)


@every_method
def test_without_a_sweep_nothing_is_built_for_sweeps(known, monkeypatch):
    def built(*_, **__):
        raise AssertionError("a table for sweeps")

    for name in ("schedule", "blocks", "along_curve"):
        monkeypatch.setattr(Topology, name, built)
    with numbered("curve"):
        assert smooth(rough(), known(max_sweeps=0)).outcome.unchanged


@every_method
def test_nothing_can_move(known):
    mesh = rough("triangles")
    result = smooth(Mesh(mesh.points, mesh.cells, fixed=np.arange(mesh.n_vertices)), known())
    assert result.outcome.stop is Stop.NOTHING_MOVES
    assert result.converged
    assert result.sweeps == 0
    assert result.reason == "no vertex can move: all are on the boundary, fixed or in no cell"


def test_a_mesh_as_good_as_the_method_gets():
    squares = Mesh(*grid(4, 4))
    for known in methods().values():
        if not known().why_not(squares):
            result = smooth(squares, known())
            assert result.outcome.unchanged, known
            assert result.converged
            assert result.reason.startswith("already as good as this method gets: unchanged")


@every_method
def test_a_time_limit_stops_it(known):
    mesh = rough()
    tangled = mesh.with_points(tangle(mesh.points, mesh.cells, np.random.default_rng(2), 1.0))
    result = smooth(tangled, known(time_limit=1e-9))
    assert result.outcome.stop is Stop.TIME_LIMIT
    assert result.outcome.stop_at == 1e-9
    assert not result.converged
    assert "the time limit of 1e-09 s was reached" in result.reason


@every_method
def test_an_interrupt_gets_through_and_changes_nothing(known):
    def stop(record):
        raise KeyboardInterrupt

    mesh = rough()
    tangled = mesh.with_points(tangle(mesh.points, mesh.cells, np.random.default_rng(2), 1.0))
    before = tangled.points.tobytes()
    with pytest.raises(KeyboardInterrupt):
        smooth(tangled, known(callback=stop))
    assert tangled.points.tobytes() == before
    assert smooth(tangled, known(max_sweeps=2)).sweeps > 0


class StopError(Exception):
    pass


@every_method
@pytest.mark.parametrize("stop", ["true", "raises"])
def test_a_callback_stops_it_with_the_best_so_far(known, stop):
    records = []

    def callback(record):
        records.append(record)
        if stop == "raises":
            raise StopError
        return np.True_

    mesh = rough()
    tangled = mesh.with_points(tangle(mesh.points, mesh.cells, np.random.default_rng(2), 1.0))
    method = known(callback=callback)
    if stop == "raises":
        with pytest.raises(StopError) as error:
            smooth(tangled, method)
        result = error.value.result
    else:
        result = smooth(tangled, method)
    assert len(records) == 1
    assert result.outcome.stop is Stop.CALLBACK
    assert not result.converged
    assert "stopped when it was told to" in result.reason
    assert result.sweeps > 0
    assert result.to_dict()["outcome"]["stop"] == "callback"
    # As far as it came when as many sweeps were allowed.
    same = smooth(tangled, known(max_sweeps=result.sweeps))
    assert same.after.n_invalid >= result.after.n_invalid


def test_whatever_is_not_true_goes_on():
    told = []
    result = smooth(rough(), "star", max_sweeps=3, rtol=0.0, callback=lambda r: told.append(r) or 1)
    assert len(told) == result.sweeps == 3


@pytest.mark.nojit
def test_no_work_begins_that_would_end_too_late(monkeypatch):
    from qsmooth.methods import watching

    now = [0.0]
    monkeypatch.setattr(watching, "clock", lambda: now[0])
    watch, stops = watching.Watch(all_methods()["star"](time_limit=10.0)), []
    for _ in range(2):
        now[0] += 4.0
        stops.append(watch.stop())
    assert stops == [None, Stop.TIME_LIMIT]  # a third would end at 12


@pytest.mark.nojit
def test_time_is_kept_back_for_what_comes_after_the_sweeps(monkeypatch):
    from qsmooth.methods import watching

    now = [0.0]
    monkeypatch.setattr(watching, "clock", lambda: now[0])
    watch, stops = watching.Watch(all_methods()["star"](time_limit=10.0)), []
    now[0] += 2.0
    watch.set_up()
    for _ in range(6):
        now[0] += 1.0
        watch.set_up()  # only the first time counts
        stops.append(watch.stop())
    assert stops == [None, None, None, None, None, Stop.TIME_LIMIT]  # at 8, and ends at 10
    assert not watch.leaves_time_for(1.5)
    assert watch.leaves_time_for(0.5)
    slow = watching.Watch(all_methods()["star"](time_limit=10.0))
    now[0] += 9.0
    slow.set_up()  # half of the time at most
    assert slow.stop() is Stop.TIME_LIMIT
    assert watching.Watch(all_methods()["star"]()).stop() is None


@pytest.mark.parametrize("name", ["star", "optimize"])
@pytest.mark.parametrize("limit", [7.0, 40.0, 95.0])
def test_a_time_limit_is_held_to_a_tenth(monkeypatch, name, limit):
    """On a clock that tells a second for each sweep, and half of one for each look."""
    from qsmooth.engine import Threads
    from qsmooth.methods import watching
    from qsmooth.optimizer import look, progress, stages

    now, run, made = [0.0], Threads.run, look.Look.__init__

    def sweep(self, *arguments):
        now[0] += 1.0
        run(self, *arguments)

    def take_a_look(self, *arguments):
        now[0] += 0.5
        made(self, *arguments)

    monkeypatch.setattr(Threads, "run", sweep)
    monkeypatch.setattr(look.Look, "__init__", take_a_look)
    for module in (watching, stages, sys.modules["qsmooth.optimizer.method"]):
        monkeypatch.setattr(module, "clock", lambda: now[0])
    assert not hasattr(progress, "clock")  # it asks the one who watches
    mesh = bump(30)
    result = smooth(
        mesh, name, time_limit=limit, threads=1, **({"rtol": 0.0} if name == "star" else {})
    )
    if result.outcome.stop is Stop.TIME_LIMIT:
        # In the end a few looks sum up.
        assert 0.5 * limit <= now[0] <= 1.1 * limit + 2.5
        assert result.outcome.stop_at == limit
    else:
        assert now[0] <= 1.1 * limit
    assert result.after.n_invalid == 0


def test_callbacks_do_not_count_as_time(monkeypatch):
    from qsmooth.methods import watching

    now = [0.0]
    monkeypatch.setattr(watching, "clock", lambda: now[0])

    def slow(record):
        now[0] += 100.0

    result = smooth(rough(), "star", time_limit=1.0, max_sweeps=3, rtol=0.0, callback=slow)
    assert result.outcome.stop is Stop.MAX_SWEEPS
    assert result.sweeps == 3


def test_progress_is_shown_when_asked_for_and_only_then(capfd):
    mesh = rough()
    smooth(mesh, "star", max_sweeps=3, rtol=0.0)
    untangle(mesh)
    assert capfd.readouterr() == ("", "")
    records, seen = [], []
    result = smooth(
        mesh, Star(max_sweeps=3, rtol=0.0, callback=records.append),
        progress=lambda record, done, most: seen.append((record, done, most)),
    )  # fmt: skip
    assert records == list(result.history)
    assert seen == [(record, k + 1, 3) for k, record in enumerate(records)]
    assert capfd.readouterr() == ("", "")
    smooth(mesh, "star", max_sweeps=3, rtol=0.0, progress=True)
    out, err = capfd.readouterr()
    assert out == ""
    last = result.history[-1]
    assert (
        err == f"qsmooth: star, 3 sweeps, angles {last.min_angle:.1f}° to {last.max_angle:.1f}°\n"
    )
    with pytest.raises(TypeError, match="progress must be True, False or a function, got 'bar'"):
        smooth(mesh, "star", progress="bar")


def test_progress_on_a_terminal_is_a_bar(monkeypatch):
    import io

    class Terminal(io.StringIO):
        encoding = "utf-8"

        def isatty(self):
            return True

    monkeypatch.setattr(sys, "stderr", Terminal())
    monkeypatch.setenv("TERM", "xterm-256color")
    stops = []
    result = smooth(rough(), progress=True, callback=lambda record: stops.append(1) or True)
    assert result.outcome.stop is Stop.CALLBACK  # the caller's own callback is heard
    assert "about 10 sweeps" in sys.stderr.getvalue()


def test_smoothing_from_several_python_threads_at_once():
    from concurrent.futures import ThreadPoolExecutor

    meshes = [rough("quads", 6, seed=k) for k in range(4)]
    alone = [smooth(mesh, "star", max_sweeps=5, threads=1).points.tobytes() for mesh in meshes]
    with ThreadPoolExecutor(4) as pool:
        together = pool.map(lambda m: smooth(m, Star(max_sweeps=5, threads=1)).points, meshes)
        assert [points.tobytes() for points in together] == alone


# ------------------------------------------------------------------------------- untangle


def test_untangle_is_its_method():
    points, cells = grid(2, 2)
    points[4] = 2.7, 0.1
    results = [untangle((points, cells), threads=1), Untangle(threads=1).run(Mesh(points, cells))]
    for result in results:
        assert result.outcome.method == "untangle"
        assert result.outcome.stop is Stop.VALID
    assert results[0].points.tobytes() == results[1].points.tobytes()
    with pytest.raises(TypeError, match="method 'untangle' has no option 'mean_los'"):
        untangle((points, cells), mean_los=0.1)
    with pytest.raises(TypeError, match="method 'untangle' has no option 'thread'; did you mean"):
        untangle((points, cells), thread=1)


# ------------------------------------------------------------------------------- compare


def test_every_method_from_the_same_start_each_with_the_options_it_has():
    mesh = rough()
    results, skipped = compare(mesh, max_sweeps=2, step=0.5)
    assert [*results] == [*methods()]
    assert skipped == {}
    for name, result in results.items():
        own = {"step": 0.5} if "step" in methods()[name].specs() else {}
        assert result.points.tobytes() == smooth(mesh, name, max_sweeps=2, **own).points.tobytes()


def test_some_methods_by_name_or_with_options():
    mesh = Mesh(*annulus(12, 3))
    results, skipped = compare(
        mesh, ["star", Laplacian(max_sweeps=1), "aspect-ratio"], max_sweeps=2
    )
    assert [*results] == ["star", "laplacian"]
    assert results["laplacian"].sweeps == 1
    assert list(skipped) == ["aspect-ratio"]
    assert "for triangles and there is none" in skipped["aspect-ratio"]
    with pytest.raises(ValueError, match="for triangles and there is none"):
        compare(mesh, ["aspect-ratio"])


def test_options_that_no_compared_method_has():
    with pytest.raises(TypeError, match="no option 'mean_loss' in any of the methods star, quad"):
        compare(rough(), ["star", "quad"], mean_loss=0.1)
    with pytest.raises(TypeError, match="no option 'stepp'"):
        compare(rough(), [Angle(), "star"], stepp=0.5)
    with pytest.raises(ValueError, match=r"step must be in \(0, 1\], got 3"):
        compare(rough(), ["star"], step=3)
    with pytest.raises(ValueError, match="did you mean 'star'"):
        compare(rough(), ["stra"])
