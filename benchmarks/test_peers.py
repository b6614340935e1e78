"""Other programs on meshes of 2K cells, and qsmooth as far as each came; see `peers.py`."""

import pytest

from peer_meshes import make, measure
from peer_programs import PROGRAMS
from qsmooth import warmup
from time_to_quality import Calls

QUICK = [name for name, program in PROGRAMS.items() if program.quick]
KINDS = ("lake", "triangles")


@pytest.mark.benchmark(group="peers, 2K cells")
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", QUICK)
def test_program_and_qsmooth_as_far(benchmark, print_ratio, smoke, name, kind):
    program = PROGRAMS[name]
    pytest.importorskip(program.package, reason=f"{program.package} is not installed")
    points, cells = make(kind, 64 if smoke else 2000)
    results = []

    def start():
        run, result = program.start(points.copy(), cells.copy())
        results.append(result)
        return (run,), {}

    benchmark.pedantic(lambda run: run(), setup=start, rounds=1 if smoke else 3)
    wanted = measure(results[-1](), cells)
    benchmark.extra_info.update(cells=len(cells), threads=1, **wanted._asdict())
    if wanted.invalid or smoke:
        return
    warmup()
    reached = Calls(points, cells).quickest(wanted, 2.0, program.guarded)
    if reached is None:
        print_ratio(f"{name}, {kind}: no method of qsmooth came as far")
        return
    ratio = benchmark.stats.stats.median / reached.seconds
    benchmark.extra_info.update(as_far=reached.seconds, by=reached.method, times=round(ratio, 2))
    print_ratio(
        f"{program.title}, {kind}, {len(cells)} cells: {1e3 * benchmark.stats.stats.median:.3g} ms "
        f"to a scaled Jacobian of {wanted.worst:.3f}; qsmooth {1e3 * reached.seconds:.3g} ms by "
        f"{reached.sweeps} sweeps of {reached.method}, {ratio:.3g} times as fast"
    )


@pytest.mark.benchmark(group="peers, 2K cells")
@pytest.mark.parametrize("kind", KINDS)
def test_qsmooth_to_its_end(benchmark, smoke, kind):
    points, cells = make(kind, 64 if smoke else 2000)
    calls, results = Calls(points, cells), []
    calls.timed("optimize", 20)
    benchmark.pedantic(lambda: results.append(calls.timed("optimize")[1]), rounds=1 if smoke else 3)
    figures = measure(results[-1].points, cells)
    benchmark.extra_info.update(cells=len(cells), threads=1, **figures._asdict())
