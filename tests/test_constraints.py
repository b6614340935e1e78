"""Constraints: what stays, stays to the bit; no vertex is ever anywhere but where it may be."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import promises
from promises import invalid_cells
from qsmooth import smooth
from qsmooth.numbering import numbered
from qsmooth.registry import all_methods

every_method = pytest.mark.parametrize("known", all_methods().values(), ids=all_methods())


@st.composite
def constrained(draw):
    """A mesh, valid or tangled, and constraints of its vertices."""
    mesh = draw(promises.valid_meshes() | promises.tangled_meshes())
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    size = float(np.ptp(mesh.points, axis=0).max())
    given_, n = {}, mesh.n_vertices
    if draw(st.booleans()):
        given_["fixed"] = rng.random(n) < 0.3
    if draw(st.booleans()):
        given_["max_move"] = size * draw(st.sampled_from([1e-3, 1e-2, 0.1]))
    if draw(st.booleans()):
        given_["max_move_share"] = draw(st.sampled_from([1e-3, 0.1, 0.5]))
    if draw(st.booleans()):
        directions = rng.normal(size=(n, 2))
        directions[rng.random(n) < 0.3] = (1.0, 0.0)
        directions[rng.random(n) < 0.4] = np.nan
        given_["directions"] = directions
    return mesh, given_


def shortest_edges(mesh):
    shortest = np.full(mesh.n_vertices, np.inf)
    for v in range(mesh.n_vertices):
        ring = mesh.ring_vertices[mesh.ring_offsets[v] : mesh.ring_offsets[v + 1]]
        if ring.size:
            shortest[v] = np.linalg.norm(mesh.xy[ring] - mesh.xy[v], axis=1).min()
    return shortest


def check(mesh, points, given_):
    """Every vertex is where the constraints let it be."""
    moves = (points - mesh.points)[:, :2]
    lengths = np.linalg.norm(moves, axis=1)
    assert points[mesh.is_fixed].tobytes() == mesh.points[mesh.is_fixed].tobytes()
    if "fixed" in given_:
        fixed = given_["fixed"]
        assert points[fixed].tobytes() == mesh.points[fixed].tobytes()
    if "max_move" in given_:
        assert (lengths <= given_["max_move"]).all()
    if "max_move_share" in given_:
        assert (lengths <= given_["max_move_share"] * shortest_edges(mesh)).all()
    if "directions" in given_:
        on_line = np.isfinite(given_["directions"]).all(axis=1)
        ux, uy = given_["directions"][on_line].T
        off = np.abs(moves[on_line, 0] * uy - moves[on_line, 1] * ux) / np.hypot(ux, uy)
        assert (off <= 3.0 * np.spacing(np.abs(points[:, :2]).max())).all()


@every_method
@given(st.data())
@settings(max_examples=30)
def test_no_vertex_is_where_it_may_not_be(known, data):
    mesh, given_ = data.draw(constrained())
    method = known(max_sweeps=40, threads=1, **given_)
    if method.why_not(mesh):
        return
    result = smooth(mesh, method)
    check(mesh, result.points, given_)
    if method.guards:
        before, after = invalid_cells(mesh), invalid_cells(result.mesh)
        assert after.sum() <= before.sum()
        assert known.untangles or not (after & ~before).any()


@every_method
@given(st.data())
@settings(max_examples=8)
def test_neither_threads_nor_numbering_change_a_bit_of_it(known, data):
    mesh, given_ = data.draw(constrained())
    method = known(max_sweeps=20, **given_)
    if method.why_not(mesh):
        return
    points = smooth(mesh, known(max_sweeps=20, threads=1, **given_)).points
    assert smooth(mesh, known(max_sweeps=20, threads=2, **given_)).points.tobytes() == (
        points.tobytes()
    )
    with numbered("curve"):
        inside = smooth(mesh, known(max_sweeps=20, threads=1, **given_)).points
    assert inside.tobytes() == points.tobytes()
