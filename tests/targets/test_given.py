"""Targets that a caller asks for."""

import math

import numpy as np
import pytest

import meshes
from qsmooth import Mesh, examples
from qsmooth.targets import EQUILATERAL, SQUARE, from_metric, from_ratios, ideal, initial
from reference_targets import energies, unit


def test_ideal_cells_are_those_of_the_kernels():
    from qsmooth.kernels import corner_energy

    assert tuple(SQUARE) == corner_energy.SQUARE
    assert tuple(EQUILATERAL) == pytest.approx(corner_energy.EQUILATERAL)
    mesh = examples.structured(4, 2, kind="mixed")
    targets = ideal(mesh.topology)
    f, _ = energies(mesh, targets)
    assert unit(targets) == pytest.approx(np.ones(f.size))
    assert not targets.size_weight.any()
    assert np.isnan(targets.area).all()


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0])
def test_initial_is_what_rectangles_and_triangles_are(turn):
    points, blocks = meshes.graded(3, 3)
    quads = blocks[0]
    c, s = math.cos(turn), math.sin(turn)
    turned = points @ np.array([[c, s], [-s, c]])
    mesh = Mesh(turned, [meshes.split(quads[:5], np.arange(5) % 2 == 0), quads[5:]])
    targets = initial(mesh.topology, mesh.xy)
    f, tau = energies(mesh, targets)
    assert f == pytest.approx(np.ones(f.size), rel=1e-9)
    assert tau == pytest.approx(np.ones(f.size), rel=1e-9)
    assert (targets.size_weight == 1.0).all()


def test_initial_asks_a_sheared_quad_for_right_angles_in_its_own_direction():
    mesh = Mesh([(0, 0), (4, 0), (5, 1), (1, 1)], [(0, 1, 2, 3)])
    targets = initial(mesh.topology, mesh.xy)
    assert targets.area[0] == pytest.approx(4.0)
    xx, xy, yy = targets.maps[0]
    root = np.array([[xx, xy], [xy, yy]])
    values, axes = np.linalg.eigh(root)
    # Sides 4 and √2 in proportion; the axes halfway between those of the sides, at 0 and −45°.
    assert values[1] / values[0] == pytest.approx(4.0 / math.sqrt(2.0))
    angle = math.degrees(math.atan2(axes[1, 0], axes[0, 0])) % 180.0
    assert angle == pytest.approx(157.5)


def test_ratios_are_in_the_callers_order_and_orientation():
    points = [(0, 0), (3, 0), (6, 0), (0, 1), (3, 1), (6, 1)]
    # The first counter-clockwise from a long side, the second clockwise, from a short one.
    mesh = Mesh(points, [(0, 1, 4, 3), (1, 4, 5, 2)])
    assert mesh.topology.turned.tolist().count(True) == 1
    targets = from_ratios(mesh, [3.0, 1.0 / 3.0])
    f, _ = energies(mesh, targets)
    assert f == pytest.approx(np.ones(8))
    assert energies(mesh, from_ratios(mesh, [3.0, 3.0]))[0][4:] == pytest.approx(np.full(4, 41 / 9))


@pytest.mark.parametrize(
    ("ratios", "said"),
    [
        ([1.0], r"must have the shape \(2,\), got \(1,\)"),
        ([1.0, 0.0], "must be positive, got 0.0 for cell 1"),
        ([math.nan, 1.0], "must be positive, got nan for cell 0"),
        ("few", "must be real numbers"),
        ([1.0, 1j], "must be real numbers: they are complex"),
    ],
)
def test_bad_ratios_are_named(ratios, said):
    with pytest.raises(ValueError, match=said):
        from_ratios(examples.structured(2, 1), ratios)


def test_ratios_are_for_quads():
    with pytest.raises(ValueError, match="meshes of quads only"):
        from_ratios(examples.structured(2, 1, kind="mixed"), [1.0] * 3)


@pytest.mark.parametrize("kind", ["quad", "triangle"])
def test_cells_of_size_one_in_a_metric_are_at_their_target(kind):
    side = np.array([[0.5, 0.0], [0.0, 2.0]])  # from unit cells to those of the mesh
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    flat = meshes.grid(2, 2)[0]
    if kind == "triangle":
        flat = flat @ np.array([[1.0, 0.0], [0.5, math.sqrt(0.75)]])
    quads = meshes.grid(2, 2)[1][0]
    # Equilateral halves: cut along the shorter diagonal.
    cells = meshes.split(quads, np.zeros(4, bool)) if kind == "triangle" else quads
    to_mesh = turn @ side
    mesh = Mesh(flat @ to_mesh.T, cells)
    tensor = np.linalg.inv(to_mesh @ to_mesh.T)
    for metric in (
        np.tile(tensor, (9, 1, 1)),
        lambda places: np.tile(tensor, (len(places), 1, 1)),
    ):
        f, tau = energies(mesh, from_metric(mesh, metric))
        assert f == pytest.approx(np.ones(f.size))
        assert tau == pytest.approx(np.ones(f.size))


def test_tensors_are_averaged_in_logarithms_and_functions_asked_where_vertices_are():
    mesh = Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)])
    tensors = np.array([np.diag([4.0**k, 1.0]) for k in range(4)])
    assert from_metric(mesh, tensors).area[0] == pytest.approx(2.0**-1.5)

    def by_place(places):
        return places[:, :1, None] ** -2 * np.eye(2)

    assert from_metric(mesh, by_place).area[0] == pytest.approx(0.25)
    assert from_metric(mesh, by_place, mesh.xy + 1.0).area[0] == pytest.approx(2.25)


def fourth(tensor):
    """Four unit tensors, of which the last is another."""
    return np.concatenate([np.tile(np.eye(2), (3, 1, 1)), [tensor]])


@pytest.mark.parametrize(
    ("metric", "said"),
    [
        (np.ones((4, 2)), r"tensors must be one for each of 4 vertices, \(4, 2, 2\), got \(4, 2\)"),
        (fourth([[1.0, 2.0], [2.0, 1.0]]), "must be positive definite, that of vertex 3 is not: "),
        (fourth([[0.0, 0.0], [0.0, 0.0]]), "must be positive definite, that of vertex 3 is not: "),
        (fourth([[1e20, 0.0], [0.0, 1.0]]), "must be positive definite, that of vertex 3 is not: "),
        (fourth([[1.0, 0.5], [0.0, 1.0]]), r"be symmetric, that of vertex 3 is not: \[\[1.0, 0.5"),
        (fourth([[1.0, 0.0], [0.0, np.nan]]), "must be finite, that of vertex 3 is not: "),
        (fourth([[np.inf, 0.0], [0.0, 1.0]]), "must be finite, that of vertex 3 is not: "),
        (np.ones((4, 2, 2)) * 1j, "must be real numbers: they are complex"),
        (lambda places: np.zeros((1, 2, 2)), "of the function .* definite, that of cell 0 is not"),
        (lambda places: places, "tensors of the function must be one for each of 1 cells"),
        (lambda places: None, "tensors of the function must be one for each of 1 cells"),
        ("round", "must be real numbers"),
    ],
)
def test_bad_metrics_are_named(metric, said):
    mesh = Mesh([(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1, 2, 3)])
    with pytest.raises(ValueError, match=said):
        from_metric(mesh, metric)


def test_what_a_function_raises_says_what_it_was_called_for():
    def broken(places):
        raise KeyError("no such place")

    with pytest.raises(KeyError, match="no such place") as found:
        from_metric(examples.structured(2, 1), broken)
    assert found.value.__notes__ == [
        "raised by the function given as target, for 2 places, an array (2, 2)"
    ]


@pytest.mark.parametrize("unit", [1e-60, 1e60])
def test_metrics_are_in_any_unit(unit):
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    tensors = np.tile([[2.0, 0.5], [0.5, 1.0]], (4, 1, 1))
    plain = from_metric(Mesh(square, [(0, 1, 2, 3)]), tensors)
    other = from_metric(Mesh(square * unit, [(0, 1, 2, 3)]), tensors / unit / unit)
    assert other.maps == pytest.approx(plain.maps)
    assert other.area / plain.area / unit / unit == pytest.approx(1.0)


@pytest.mark.parametrize(("factor", "area"), [(1e-100, "1e.100"), (1e100, "1e-100")])
def test_metrics_in_another_unit_than_the_mesh_are_named(factor, area):
    mesh = examples.structured(2, 1)
    with pytest.raises(ValueError, match=f"asks cell 0 for an area of {area}, which is out of"):
        from_metric(mesh, np.tile(np.eye(2) * factor, (6, 1, 1)))
