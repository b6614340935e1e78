import json
import os

import numpy as np
import pytest

from qsmooth import Mesh, read_mesh
from qsmooth.errors import MeshError
from qsmooth.inspection import inspect
from qsmooth.output.tables import inspection_table

pytestmark = pytest.mark.nojit

SQUARES = [(0, 0), (1, 0), (2, 0), (0, 1), (1, 1), (2, 1)]


def finding(facts, name):
    return next(f for f in facts.findings if f.name == name)


def odd(facts):
    return {f.name: f.count for f in facts.findings if f.count}


def test_two_squares():
    facts = inspect((SQUARES, [[0, 1, 4, 3], [1, 2, 5, 4]]))
    assert (facts.n_quads, facts.n_triangles, facts.n_vertices) == (2, 0, 6)
    assert (facts.n_edges, facts.n_boundary_edges, facts.n_boundary_loops) == (7, 6, 1)
    assert (facts.n_parts, facts.n_turned, facts.orientation) == (1, 0, "counter-clockwise")
    assert facts.low == (0.0, 0.0)
    assert facts.high == (2.0, 1.0)
    assert facts.plane == "2D"
    assert odd(facts) == {}


def test_a_hole_is_a_loop():
    ring = [(np.cos(t), np.sin(t)) for t in np.arange(6) * np.pi / 3]
    points = np.array([*ring, *(2 * np.array(ring))])
    cells = [[i, 6 + i, 6 + (i + 1) % 6, (i + 1) % 6] for i in range(6)]
    assert inspect((points, cells)).n_boundary_loops == 2


def test_orientation_in_words():
    assert inspect((SQUARES, [[3, 4, 1, 0], [4, 5, 2, 1]])).orientation == "clockwise"
    facts = inspect((SQUARES, [[0, 1, 4, 3], [4, 5, 2, 1]]))
    assert facts.orientation == "mixed: 1 cell of 2 run clockwise"
    assert facts.n_turned == 1


def test_regions_are_counted():
    facts = inspect(Mesh(SQUARES, [[0, 1, 4, 3], [1, 2, 5, 4]], regions=[7, -1]))
    assert facts.regions == {-1: 1, 7: 1}
    assert facts.n_interface == 2


def test_orphans():
    facts = inspect(([*SQUARES, (9, 9), (9, 9)], [[0, 1, 4, 3], [1, 2, 5, 4]]))
    assert finding(facts, "orphan vertices").items == (6, 7)
    assert odd(facts) == {"orphan vertices": 2}  # orphans at one place are no coincidence


def test_coincident_vertices_and_parts():
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (1, 0), (2, 0), (2, 1), (1, 1)]
    facts = inspect((points, [[0, 1, 2, 3], [4, 5, 6, 7]]))
    assert finding(facts, "coincident vertices").items == ((1, 4), (2, 7))
    assert odd(facts) == {"coincident vertices": 2, "unmerged edges": 1, "disconnected parts": 1}
    assert finding(facts, "disconnected parts").items == (1,)
    assert facts.n_parts == 2


def test_three_vertices_at_one_place_are_two_too_many():
    points = [(0.0, 0), (1, 0), (0, 1), (-0.0, 0), (-1, 0), (0, -1), (0, 0), (3, 3), (3, 4)]
    facts = inspect((points, [[0, 1, 2], [3, 4, 5], [6, 7, 8]]))
    assert finding(facts, "coincident vertices").items == ((0, 3, 6),)
    assert finding(facts, "coincident vertices").count == 2


def test_zero_length_edges():
    facts = inspect(([(0, 0), (1, 0), (1, 0), (0, 1)], [[0, 1, 2, 3]]))
    assert finding(facts, "zero-length edges").items == ((1, 2),)
    assert odd(facts) == {
        "zero-length edges": 1,
        "coincident vertices": 1,
        "cells not valid": 1,
        "cells that can't be valid": 1,
    }


def test_doublets_and_cells_that_cannot_be_valid():
    # A square cut in two by a vertex that only its two halves share; beside it, a dart.
    points = [(0, 0), (2, 0), (2, 2), (0, 2), (0.5, 1), (4, 0), (2.5, 0.5)]
    facts = inspect((points, [[0, 1, 2, 4], [0, 4, 2, 3], [1, 5, 2, 6]]))
    assert finding(facts, "doublets").items == (4,)
    assert finding(facts, "cells that can't be valid").items == (1, 2)
    # Where the vertex in the corner may move nothing is proven of its cells.
    points = [(x, y) for y in range(3) for x in range(3)]
    points[4] = (2.5, 2.5)
    facts = inspect((points, [[0, 1, 4, 3], [1, 2, 5, 4], [3, 4, 7, 6], [4, 5, 8, 7]]))
    assert odd(facts) == {"cells not valid": 3}


def test_pinched_vertices():
    points = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 1), (2, 2), (1, 2)]
    facts = inspect((points, [[0, 1, 2, 3], [2, 4, 5, 6]]))
    assert finding(facts, "pinched vertices").items == (2,)
    assert odd(facts) == {"pinched vertices": 1, "disconnected parts": 1}


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 2])
def test_hanging_nodes(unit, angle):
    # A large square beside two small ones: vertex 4 hangs on the edge 1-2.
    points = [(0, 0), (2, 0), (2, 2), (0, 2), (2, 1), (3, 0), (3, 1), (3, 2)]
    turn = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    points = unit * np.array(points, float) @ turn
    facts = inspect((points, [[0, 1, 2, 3], [1, 5, 6, 4], [4, 6, 7, 2]]))
    assert finding(facts, "hanging nodes").items == (4,)


def test_a_vertex_near_an_edge_does_not_hang():
    points = [(0, 0), (2, 0), (2, 2), (0, 2), (2.001, 1), (3, 0), (3, 1), (3, 2)]
    facts = inspect((points, [[0, 1, 2, 3], [1, 5, 6, 4], [4, 6, 7, 2]]))
    assert finding(facts, "hanging nodes").count == 0


def test_cells_not_valid():
    points = [(0, 0), (2, 0), (0.5, 0.5), (0, 2)]
    facts = inspect((points, [[0, 1, 2, 3]]))
    assert finding(facts, "cells not valid").items == (0,)
    assert facts.validity["concave"] == 1


def test_planes_in_words():
    flat = np.column_stack([SQUARES, np.full(6, 5.0)])
    cells = [[0, 1, 4, 3], [1, 2, 5, 4]]
    assert inspect((flat, cells)).plane == "3D, z = 5"
    tilted = flat.copy()
    tilted[:, 2] = tilted[:, 0]
    assert inspect((tilted, cells)).plane == "3D, a tilted plane"
    assert inspect(Mesh(tilted, cells, surface="flat")).plane == "3D, z from 0 to 2 as a value"


def test_facts_are_fit_for_json_and_cut():
    points = [*SQUARES, *((k, 9) for k in range(30))]
    facts = inspect((points, [[0, 1, 4, 3]]))
    plain = json.loads(json.dumps(facts.to_dict(3), allow_nan=False))
    orphans = plain["findings"]["orphan vertices"]
    assert orphans == {"count": 32, "kind": "vertex", "first": [2, 5, 6]}
    text = str(inspection_table(facts, 3))
    assert "32, in no cell: vertices 2, 5, 6, ..." in text
    assert ": vertices" not in str(inspection_table(facts, 0))


@pytest.mark.skipif("NUMBA_DISABLE_JIT" in os.environ, reason="takes minutes in plain Python")
@pytest.mark.filterwarnings("ignore::qsmooth.errors.MeshWarning")
def test_every_readable_mesh_can_be_inspected(shared_meshes):
    n_read = 0
    for path in sorted(shared_meshes.iterdir()):
        if path.suffix in (".poly", ".py", ".md"):
            continue
        try:
            mesh = read_mesh(path, surface="flat")
        except MeshError:
            continue
        n_read += 1
        facts = inspect(mesh)
        json.dumps(facts.to_dict(), allow_nan=False)
        assert facts.n_quads + facts.n_triangles == mesh.n_cells
        # Euler: vertices in cells - edges + cells, per part 2 - loops; pinches join parts.
        if not odd(facts):
            n_used = facts.n_vertices
            assert n_used - facts.n_edges + mesh.n_cells == 2 - facts.n_boundary_loops
    assert n_read > 30


def test_hanging_nodes_of_a_real_mesh(shared_meshes):
    facts = inspect(read_mesh(shared_meshes / "sfepy_hanging_nodes.mesh"))
    assert finding(facts, "hanging nodes").items == (12, 14, 16, 18)
