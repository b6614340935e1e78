"""Each metric on its own: compiled by an untimed call, then on a mesh in cache and one beyond."""

import pytest

from qsmooth import Quality
from qsmooth.kernels._jit import use_threads
from qsmooth.metrics import METRICS

THREADS = [1, 2]


@pytest.mark.benchmark(group="metrics")
@pytest.mark.parametrize("threads", THREADS)
@pytest.mark.parametrize("metric", METRICS.values(), ids=METRICS.keys())
def test_metric(benchmark, mesh, note, metric, threads):
    topology = mesh.topology
    note(mesh, threads)

    def measure():
        return metric.measure(Quality(topology, mesh.xy))

    with use_threads(threads):
        measure()
        benchmark(measure)


@pytest.mark.benchmark(group="metrics")
@pytest.mark.parametrize("metrics", [None, "all"])
def test_summary(benchmark, mesh, note, metrics):
    note(mesh)

    def sum_up():
        return Quality(mesh.topology, mesh.xy).summary(metrics)

    sum_up()
    benchmark(sum_up)


@pytest.mark.benchmark(group="metrics")
def test_validity(benchmark, mesh, note):
    note(mesh)
    assert Quality(mesh.topology, mesh.xy).validity.shape == (mesh.n_cells,)
    benchmark(lambda: Quality(mesh.topology, mesh.xy).validity)
