"""The order in memory: chosen by how scattered a mesh is, and nothing that a caller could see."""

import numpy as np
import pytest

from meshes import fan, grid, random_mesh, renumber, rough_grid, tilt
from qsmooth import Mesh, examples, quality, smooth, untangle
from qsmooth.kernels.numbering import LEVELS, curve_order
from qsmooth.numbering import Inside, is_scattered, numbered
from qsmooth.registry import methods


def plain(value):
    """What a result says, but for how long it took."""
    if isinstance(value, dict):
        return {name: plain(part) for name, part in value.items() if name != "seconds"}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return str(value)


def require_same(call):
    """Run it in the caller's numbering and in one along a curve, and compare every bit."""
    runs = []
    for how in ("kept", "curve"):
        told = []
        with numbered(how):
            result = call(told.append)
        runs.append((result, plain(result.to_dict()), told))
    (kept, said, told), (curved, *others) = runs
    assert kept.points.tobytes() == curved.points.tobytes()
    assert [said, told] == others
    return kept


def scattered(n=12, seed=0):
    rng = np.random.default_rng(seed)
    points, cells, _ = renumber(*rough_grid(n), rng)
    return Mesh(points, cells)


MESHES = {
    "quads": lambda: scattered(),
    "triangles": lambda: examples.random_triangles(150),
    "mixed": lambda: random_mesh("mixed", 7, seed=0, turned=0.5).mesh,
    "tangled": lambda: examples.tangled(),
    "tilted": lambda: Mesh(tilt(rough_grid(8)[0]), rough_grid(8)[1]),
}
EVERY = [name for name in methods() if name != "untangle"]


@pytest.mark.parametrize("name", EVERY)
@pytest.mark.parametrize("kind", MESHES)
def test_results_have_the_same_bits_in_either_order(kind, name):
    mesh, more = MESHES[kind](), {}
    if methods()[name]().why_not(mesh):
        more = {"split_quads": True}
    result = require_same(lambda told: smooth(mesh, name, max_sweeps=60, callback=told, **more))
    assert result.sweeps > 0


@pytest.mark.parametrize("kind", ["tangled", "quads"])
def test_untangling_has_the_same_bits_in_either_order(kind):
    require_same(lambda told: untangle(MESHES[kind](), callback=told))
    points, cells, _ = renumber(*grid(9, 9), np.random.default_rng(4))
    random = np.random.default_rng(1).random(points.shape) * 9
    inner = ~Mesh(points, cells).is_boundary
    points[inner] = random[inner]
    assert require_same(lambda told: untangle((points, cells), callback=told)).sweeps > 0


def test_steps_on_the_whole_mesh_have_the_same_bits_in_either_order():
    mesh = examples.notch()
    result = require_same(lambda _: smooth(mesh, max_sweeps=200))
    assert sum(stage.steps for stage in result.outcome.stages) > 0


def stretched(places):
    return np.eye(2) * (1.0 + places[:, 0] ** 2)[:, None, None]


@pytest.mark.parametrize(
    "options",
    [
        {"target": "initial"},
        {"target": stretched},
        {"target": "ratios"},
        {"target": "tensors"},
        {"selection": "max_angle > 110", "selection_rings": 1},
        {"hold": ["aspect_ratio", "shape", "min_edge"], "target": "ideal"},
        {"method": "star", "selection": "max_angle > 100", "worst_fraction": 0.4},
        {"method": "quad", "worst_fraction": 0.3, "worst_first": True},
    ],
    ids=lambda options: " ".join(map(str, options.values()))[:30],
)
def test_what_callers_give_is_theirs_in_either_order(options):
    mesh, options = scattered(), dict(options)
    if isinstance(options.get("target"), str) and options["target"] == "ratios":
        options["target"] = np.linspace(0.5, 2.0, mesh.n_cells)
    if isinstance(options.get("target"), str) and options["target"] == "tensors":
        options["target"] = np.eye(2) * np.linspace(1.0, 2.0, mesh.n_vertices)[:, None, None]
    method = options.pop("method", "optimize")
    result = require_same(lambda _: smooth(mesh, method, max_sweeps=60, **options))
    assert not result.outcome.unchanged


def test_equal_cells_are_ranked_by_the_callers_numbers():
    points, cells, _ = renumber(*grid(8, 8), np.random.default_rng(1))
    points = points + 0.2 * np.sin(points[:, ::-1])  # many angles are equal
    mesh = Mesh(points, cells, fixed=[0])
    require_same(lambda _: smooth(mesh, "star", worst_fraction=0.37, max_sweeps=5))


def test_cells_are_named_by_the_callers_numbers():
    points, cells, _ = renumber(*fan(5), np.random.default_rng(3))
    mesh = Mesh(points, cells, fixed=np.ones(len(points), bool))
    with numbered("curve"):
        inside = Inside(mesh)
        own = inside.quality(mesh)
        assert own.worst(3).to_dict() == quality(mesh).worst(3).to_dict()
        assert plain(own.summary("all").to_dict()) == plain(quality(mesh).summary("all").to_dict())
        assert plain(list(own.angles)) == plain(list(quality(mesh).angles))
    assert np.array_equal(inside.back(inside.at_vertices(mesh.xy)), mesh.xy)
    assert inside.topology.is_renumbered


def test_only_a_scattered_mesh_is_renumbered():
    points, cells = rough_grid(150)
    rng = np.random.default_rng(0)
    assert not is_scattered(Mesh(points, cells).topology)
    assert is_scattered(Mesh(*renumber(points, cells, rng)[:2]).topology)
    assert is_scattered(Mesh(points, rng.permutation(cells[0])).topology)
    for mesh in (Mesh(points, cells), scattered(40)):  # small ones fit in the cache
        assert Inside(mesh).topology is mesh.topology


def test_a_scattered_mesh_is_smoothed_as_ever():
    points, cells, _ = renumber(*rough_grid(90), np.random.default_rng(0))
    mesh = Mesh(points, cells)
    assert is_scattered(mesh.topology)
    result = require_same(lambda _: smooth(mesh, "star", max_sweeps=3))
    with numbered("measured"):
        assert smooth(mesh, "star", max_sweeps=3).points.tobytes() == result.points.tobytes()
    assert result.after.n_invalid == 0
    assert result.after.worst["scaled_jacobian"] >= result.before.worst["scaled_jacobian"]


@pytest.mark.nojit
def test_the_curve_goes_from_neighbour_to_neighbour():
    points = grid(15, 15)[0]
    order = curve_order(points, np.zeros(2), np.full(2, (2**LEVELS - 1) / 15.0))
    assert sorted(order) == list(range(len(points)))
    assert np.abs(np.diff(points[order], axis=0)).sum(axis=1).max() == 1.0


@pytest.mark.nojit
def test_the_same_cells_in_another_order():
    mesh = random_mesh("mixed", 6, seed=2, turned=0.5).mesh
    outer, inner = mesh.topology, mesh.topology.along_curve(mesh.xy)
    assert mesh.topology.along_curve(mesh.xy) is inner
    v, c = inner.vertex_ids, inner.cell_ids
    assert sorted(v) == list(range(outer.n_vertices))
    assert sorted(c) == list(range(outer.n_cells))
    for i, cell in enumerate(c):
        ours = inner.cell_vertices[inner.cell_offsets[i] : inner.cell_offsets[i + 1]]
        theirs = outer.cell_vertices[outer.cell_offsets[cell] : outer.cell_offsets[cell + 1]]
        assert v[ours].tolist() == theirs.tolist()
    for i, vertex in enumerate(v):
        for name in ("is_boundary", "is_fixed", "is_interface", "used"):
            assert getattr(inner, name)[i] == getattr(outer, name)[vertex]
        rows = [
            ids[values[offsets[k] : offsets[k + 1]]].tolist()
            for ids, values, offsets, k in (
                (v, inner.rings[1], inner.rings[0], i),
                (np.arange(v.size), outer.rings[1], outer.rings[0], vertex),
                (c, inner.star_cells, inner.star_offsets, i),
                (np.arange(c.size), outer.star_cells, outer.star_offsets, vertex),
            )
        ]
        assert rows[0] == rows[1]
        assert rows[2] == rows[3]
    assert np.array_equal(
        inner.cell_vertices[inner.star_corners],
        np.repeat(np.arange(v.size), np.diff(inner.star_offsets)),
    )
