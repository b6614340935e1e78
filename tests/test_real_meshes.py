"""Every mesh of the shared folder: valid stays valid, and the paper's figures improve."""

from dataclasses import replace

import numpy as np
import pytest

import promises
import reference
from qsmooth import (
    Laplacian,
    Mesh,
    MeshError,
    SmartLaplacian,
    Stop,
    Validity,
    quality,
    read_mesh,
    smooth,
)
from qsmooth.registry import methods

# Meshes that are valid, and their cells; z is a value in two of them.
VALID = {
    "superior_24k.off": 24141,
    "spiral_2k.off": 1911,
    "superior_sibl_30k.off": 30006,
    "superior_hohq_1505.obj": 1505,
    "malpasset_2392.obj": 2392,
    "hughes_qt_cpe4.inp": 4505,
    "mesquite_square_rand.vtk": 100,
    "mesquite_quads_4by2_bad.vtk": 8,
    "mesquite_plane_not_xy.vtk": 4,  # with six digits
    "mesquite_unstrquad.vtk": 30,
    "mesquite_hole_scheme.vtk": 72,
    "mesquite_polar_mixed.vtk": 240,
    "mesquite_overture_mixed.vtk": 5213,
    "mesquite_tri10.vtk": 10,
    "mesquite_tri48_circle.vtk": 48,
    "naca0012_113x33.su2": 3584,
    "rae2822_mixed.su2": 22842,
    "centrifugal_blade_mixed.su2": 10107,
    "cantilever_crlf.su2": 1000,
    "wall_channel_two_zones.su2": 2356,
    "tri_adapt.su2": 4592,
    "river_mixed_z.obj": 1375,
    "odense_mixed_z.obj": 724,
    "sfepy_square_triquad.mesh": 658,
    "sfepy_hanging_nodes.mesh": 10,
    "sfepy_apartment_tri.vtk": 752,
    "sfepy_tri932.mesh": 932,
    "dealii_two_holes.msh": 306,
    "dealii_step49.msh": 744,
    "dealii_hole8170.msh": 8170,
    "dealii_nsbench_ucd.inp": 60,
    "mfem_logo.mesh": 160,
}
# Meshes with invalid cells: how many of each class but valid.
TANGLED = {
    "hughes_6k.obj": {"collapsed": 1},
    "mesquite_tangled_quad.vtk": {"concave": 2},
    "mesquite_hole_tanglap.vtk": {},
    "mesquite_inverted_hole.vtk": {"inverted": 28},
    "mesquite_shest_grid32.vtk": {"concave": 9},
    "mesquite_tri58_tangled.vtk": {"inverted": 5},
}
REFUSED = {
    "mesquite_paraboloid.vtk": "leave it by up to",
    "mesquite_quad9_part.vtk": "cannot read",
    "mesquite_polygons.vtk": "cannot read",
    "libmesh_non_manifold.obj": "third or later on one edge",
}
# Each goes to every method that has all of these options.
OPTIONS = [
    {},
    {"guard": "clearance"},
    {"guard": "none"},
    {"weights": "area"},
    {"step": 1.0, "max_angle": 95.0, "min_angle": 85.0, "guard": "clearance"},
    {"step": 0.25, "worst_fraction": 0.1, "triangle_max_angle": 65.0, "triangle_min_angle": 55.0},
    {"worst_fraction": 0.1, "worst_first": True, "bad_angle": 130.0, "bad_step": 1.5},
    {"step": 1.0, "max_edge_ratio": 1.0, "guard": "clearance"},
    {"selection": "max_angle > 100", "selection_rings": 1},
]


def cases(mesh, sweeps):
    """Every method with each set of options that it takes; quads are cut where it needs that."""
    for known in methods().values():
        for options in OPTIONS:
            try:
                method = known.of({**options, "max_sweeps": sweeps})
            except (TypeError, ValueError):
                assert options
                continue
            if method.why_not(mesh):
                method = known.of({**options, "max_sweeps": sweeps, "split_quads": True})
            yield options, method


def read(folder, file) -> Mesh:
    return read_mesh(folder / file, surface="flat" if file.endswith("_z.obj") else "auto")


def test_every_mesh_of_the_folder_is_here(shared_meshes):
    files = {
        p.name
        for p in shared_meshes.iterdir()
        if p.is_file() and p.suffix not in (".md", ".py", ".poly")
    }
    assert files == {*VALID, *TANGLED, *REFUSED}


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", VALID)
def test_every_method_keeps_what_it_promises(shared_meshes, file):
    mesh = read(shared_meshes, file)
    assert mesh.n_cells == VALID[file]
    assert quality(mesh).n_invalid == 0
    for options, method in cases(mesh, 3):
        if mesh.n_cells > 5000 and options not in ({}, {"guard": "clearance"}):
            continue  # the smaller meshes have what there is of odd places
        seen = promises.check(mesh, method)
        if not options:
            two = smooth(mesh, replace(method, threads=2))
            assert two.points.tobytes() == seen.result.points.tobytes()


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", TANGLED)
def test_on_tangled_meshes_too(shared_meshes, file):
    mesh = read(shared_meshes, file)
    own = quality(mesh)
    points, cells = reference.as_complex(mesh.xy), reference.as_lists(mesh)
    assert own.validity.tolist() == [reference.validity(points, cell) for cell in cells]
    assert own.n_invalid
    for name, count in TANGLED[file].items():
        assert own.summary().validity[name] == count
    for _, method in cases(mesh, 20):
        result = promises.check(mesh, method).result
        if not method.untangles:
            assert f"{method.name} does not untangle" in result.reason


@pytest.mark.filterwarnings("ignore::qsmooth.MeshWarning")
@pytest.mark.parametrize("file", REFUSED)
def test_what_is_no_plane_mesh_of_triangles_and_quads_is_refused(shared_meshes, file):
    with pytest.raises(MeshError, match=REFUSED[file]):
        read(shared_meshes, file)


# ------------------------------------------------------------------------------- the paper's table

# Largest and mean of the largest angles and of aspect, smallest and mean of the smallest angles.
TABLE = ["max_angle", "min_angle", "aspect_ratio"]


@pytest.fixture(scope="module", params=["superior_24k.off", "spiral_2k.off"])
def compared(shared_meshes, request):
    """The mesh as `qsmooth compare` has it: every method with its defaults."""
    mesh = read(shared_meshes, request.param)
    return {
        method: smooth(mesh, method, threads=1)
        for method in ("star", "quad", "laplacian", "smart-laplacian")
    }


@pytest.mark.parametrize("method", ["star", "quad"])
def test_no_figure_of_the_papers_table_gets_worse(compared, method):
    result = compared[method]
    assert result.before.n_invalid == result.after.n_invalid == 0
    assert result.history
    assert not result.history["n_invalid"].any()
    for figures in ("worst", "mean"):
        before, after = getattr(result.before, figures), getattr(result.after, figures)
        for name in TABLE:
            if name == "min_angle":
                assert after[name] >= before[name], (figures, name)
            else:
                assert after[name] <= before[name], (figures, name)


def test_by_quad_ends_with_the_smaller_largest_angle(compared):
    assert compared["quad"].after.worst["max_angle"] <= compared["star"].after.worst["max_angle"]


def test_plain_laplacian_inverts_cells_on_the_way_and_the_guarded_one_does_not(compared):
    assert compared["laplacian"].history["n_invalid"].any()
    assert not compared["smart-laplacian"].history["n_invalid"].any()


@pytest.mark.parametrize("file", ["mesquite_hole_scheme.vtk", "mesquite_overture_mixed.vtk"])
def test_plain_laplacian_says_how_many_cells_it_inverted(shared_meshes, file):
    result = smooth(read(shared_meshes, file), Laplacian())
    n = result.after.n_invalid
    assert n > 0
    assert (result.outcome.invalid.before, result.outcome.invalid.after) == (0, n)
    assert f"laplacian is unguarded: it made {n} cells invalid" in result.reason


# ------------------------------------------------------------------------------- known answers


def test_squares_that_were_moved_become_squares_again(shared_meshes):
    # Four by two unit squares: what they were is known.
    mesh = read(shared_meshes, "mesquite_quads_4by2_bad.vtk")
    for method in ("star", "quad", "smart-laplacian"):
        result = smooth(mesh, method, max_sweeps=500, rtol=1e-6)
        assert result.after.mean["shape"] > result.before.mean["shape"]
        assert result.after.worst["max_angle"] < result.before.worst["max_angle"]


def test_wanted_anisotropy_is_not_taken_for_no_area(shared_meshes):
    for file in ("naca0012_113x33.su2", "rae2822_mixed.su2"):
        assert (quality(read(shared_meshes, file)).validity == Validity.VALID).all()


def test_a_cantilever_of_equal_rectangles_rests(shared_meshes):
    mesh = read(shared_meshes, "cantilever_crlf.su2")
    result = smooth(mesh, SmartLaplacian())
    assert result.outcome.stop is Stop.RESTS
    np.testing.assert_allclose(result.points, mesh.points, atol=1e-9)
    assert result.after.worst["max_angle"] == pytest.approx(90.0, abs=1e-6)


def test_values_on_a_flat_mesh_are_interpolated_or_carried_along(shared_meshes):
    for file in ("river_mixed_z.obj", "odense_mixed_z.obj"):
        mesh = read(shared_meshes, file)
        kept = smooth(mesh, "star", max_sweeps=3, carry="keep")
        assert np.array_equal(kept.points[:, 2], mesh.points[:, 2])
        result = smooth(mesh, "star", max_sweeps=3)
        assert np.array_equal(result.points[:, :2], kept.points[:, :2])
        moved = (result.points[:, :2] != mesh.points[:, :2]).any(axis=1)
        changed = result.points[:, 2] != mesh.points[:, 2]
        assert changed.any()
        assert not changed[~moved].any()


def test_level_meshes_keep_their_z(shared_meshes):
    for file in ("mesquite_tri48_circle.vtk", "mesquite_square_rand.vtk"):
        mesh = read(shared_meshes, file)
        assert mesh.points.shape[1] == 3
        result = smooth(mesh, "quad", max_sweeps=3)
        assert np.array_equal(result.points[:, 2], mesh.points[:, 2])
