"""What a mesh costs before its first sweep: connectivity, colours, stars, triangulation."""

import math

import numpy as np
import pytest

from meshes import renumber, rough_grid
from qsmooth import Mesh, examples, schedule
from qsmooth.kernels import colouring, delaunay, topology
from qsmooth.kernels.blocks import build_blocks
from qsmooth.kernels.numbering import LEVELS, curve_order
from qsmooth.numbering import is_scattered
from qsmooth.topology import Topology
from sweep_bounds import Work

pytestmark = pytest.mark.benchmark(group="topology")


def run(benchmark, kernel, *arguments):
    """Time one call, compiled by an untimed one."""
    kernel(*arguments)
    benchmark(kernel, *arguments)


def test_stars(benchmark, mesh, note, put_bound):
    note(mesh)
    run(benchmark, topology.stars, mesh.n_vertices, *mesh.topology.cells)
    # Corners are read twice; two tables are read and written.
    put_bound(Work(0, 0, 2 * 32 + 2 * 2 * 32 + 3 * 8))


def test_edge_twins(benchmark, mesh, note, put_bound):
    note(mesh)
    top = mesh.topology
    run(
        benchmark,
        topology.edge_twins,
        *top.cells,
        top.star_offsets,
        top.star_cells,
        top.star_corners,
    )
    put_bound(Work(0, 0, 32 + 8 + 8 + 2 * 32 + 3 * 32 + 4 * 8))


def test_rings(benchmark, mesh, note):
    note(mesh)
    run(benchmark, topology.rings, mesh.n_vertices, *mesh.topology.cells, mesh.topology.twins)


def test_colours(benchmark, mesh, note):
    topology = mesh.topology
    stars = topology.star_offsets, topology.star_cells
    arguments = topology.movable(), topology.vertex_ids, topology.cells, stars
    note(mesh, colours=schedule.colours(*arguments)[1])
    run(benchmark, schedule.colours, *arguments)


@pytest.mark.parametrize("part", ["colours", "order", "table", "blocks"])
def test_part_of_the_schedule(benchmark, note, large, part):
    mesh = Mesh(*rough_grid(large))
    topology = mesh.topology
    stars = topology.star_offsets, topology.star_cells
    note(mesh)
    all_of_it = topology.schedule()
    colours = topology.movable(), topology.vertex_ids, topology.cells, stars
    colour, n_colours = schedule.colours(*colours)
    table = colour, all_of_it.colour_offsets, *topology.cells, *stars, topology.star_corners
    kernel, arguments = {
        "colours": (schedule.colours, colours),
        "order": (colouring.order_by_colour, (colour, n_colours)),
        "table": (colouring.star_table, table),
        "blocks": (build_blocks, (all_of_it,)),
    }[part]
    kernel(*arguments)
    benchmark.pedantic(kernel, arguments, rounds=3)


@pytest.mark.parametrize("part", ["measure", "curve", "renumber"])
def test_renumbering_scattered_quads(benchmark, note, large, part):
    points, cells, _ = renumber(*rough_grid(large), np.random.default_rng(0))
    mesh = Mesh(points, cells)
    topology = mesh.topology
    note(mesh)
    span = np.zeros(2), np.full(2, (2**LEVELS - 1) / mesh.xy.max())
    order = curve_order(mesh.xy, *span)
    topology.renumbered(order)
    call, arguments = {
        "measure": (is_scattered, (topology,)),
        "curve": (curve_order, (mesh.xy, *span)),
        "renumber": (topology.renumbered, (order,)),
    }[part]
    benchmark.pedantic(call, arguments, rounds=3)


def test_mesh_of_many_quads(benchmark, note, large):
    points, cells = rough_grid(large)
    Mesh(*rough_grid(3))
    mesh = benchmark.pedantic(Mesh, (points, cells), rounds=3)
    note(mesh)


def test_schedule_of_many_quads(benchmark, note, large):
    mesh = Mesh(*rough_grid(large))
    mesh.topology.schedule()
    everyone = np.ones(mesh.n_vertices, np.bool_)  # a selection is not kept
    benchmark.pedantic(Topology.schedule, (mesh.topology, True, everyone), rounds=3)
    note(mesh)


@pytest.mark.parametrize("n_points", [500, 20_000])
def test_triangulate(benchmark, n_points):
    corners = examples.structured(1, 1).points[[0, 1, 3, 2]]
    inside = np.random.default_rng(0).random((n_points, 2))
    points = np.concatenate([corners, inside])
    order = 4 + np.argsort(np.floor(inside[:, 1] * math.sqrt(n_points / 2)), kind="stable")
    run(benchmark, delaunay.triangulate, points, order)
