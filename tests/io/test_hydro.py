"""What hydrodynamic formats hold besides cells: depths, node strings, boundaries, codes."""

import re
import warnings

import numpy as np
import pytest

from format_samples import ADCIRC, MIKE, POINTS, SMS
from meshes import rough_grid
from qsmooth import read_mesh, smooth, write_mesh
from qsmooth.errors import MeshError, MeshWarning
from qsmooth.io.chains import boundary_edges, chains
from qsmooth.io.file_content import of_mesh
from qsmooth.mesh import Mesh

XY, (QUADS,) = rough_grid(4)
# Level, and no plane: z of other formats would be refused.
LEVEL = np.round(XY[:, 0] ** 2 + XY[:, 1], 3)


def with_depths(name: str) -> str:
    """The rough grid, 16 quads, with depths or levels, in a format."""
    n = len(XY)
    z = -LEVEL if name.endswith("14") else LEVEL
    nodes = [
        f"{i + 1} {x!r} {y!r} {h!r}"
        for i, ((x, y), h) in enumerate(zip(XY.tolist(), z.tolist(), strict=True))
    ]
    cells = [" ".join(map(str, row)) for row in (QUADS + 1).tolist()]
    if name.endswith(".2dm"):
        rows = ["MESH2D"] + [f"E4Q {k + 1} {row} 1" for k, row in enumerate(cells)]
        rows += [f"ND {row}" for row in nodes]
    elif name.endswith(".mesh"):
        rows = [f"{n} NON-UTM"] + [f"{row} 0" for row in nodes] + ["16 4 25"]
        rows += [f"{k + 1} {row}" for k, row in enumerate(cells)]
    else:
        rows = ["grid", f"16 {n}", *nodes] + [f"{k + 1} 4 {row}" for k, row in enumerate(cells)]
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize("name", ["a.2dm", "fort.14", "a.mesh"])
@pytest.mark.nojit
def test_depths_are_values_and_are_interpolated(put, tmp_path, name):
    path = put(name, with_depths(name))
    mesh = read_mesh(path)
    assert mesh.surface == "flat"
    assert mesh.source.z_means == ("depth" if name == "fort.14" else "height")
    result = smooth(mesh, "laplacian", max_sweeps=2)
    write_mesh(tmp_path / f"out-{name}", result.mesh)
    back = read_mesh(tmp_path / f"out-{name}")
    assert np.array_equal(back.points, result.points)
    moved = (back.xy != mesh.xy).any(axis=1)
    assert moved.any()
    assert (back.points[moved, 2] != mesh.points[moved, 2]).all()
    before, after = path.read_text().split(), (tmp_path / f"out-{name}").read_text().split()
    differ = sum(a != b for a, b in zip(before, after, strict=True))
    assert 0 < differ <= 3 * moved.sum()


def test_depths_become_levels_and_back(put, tmp_path):
    mesh = read_mesh(put("fort.14", with_depths("fort.14")))
    assert np.array_equal(mesh.points[:, 2], -LEVEL)
    for name in ("a.2dm", "a.mesh", "b.gr3"):
        form = "mike" if name == "a.mesh" else None
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MeshWarning)  # codes of MIKE
            write_mesh(tmp_path / name, mesh, format=form)
        mesh = read_mesh(tmp_path / name)
        assert np.array_equal(mesh.points[:, 2], -LEVEL if name == "b.gr3" else LEVEL), name


def test_node_strings_run_over_lines_and_may_be_of_one_node(put):
    source = read_mesh(put("a.2dm", SMS)).source
    assert [kind for kind, _ in source.blocks] == ["quad", "triangle", "line", "vertex"]
    assert source.blocks[2][1].tolist() == [[0, 1], [1, 2]]
    assert source.blocks[3][1].tolist() == [[7]]
    assert [tags.tolist() for tags in source.tags] == [[7, 8], [8], [9, 9], [3]]
    assert source.names == {"left part": (7, 2), "shore": (9, 1)}
    assert source.extras == ("SMS cards BEGPARAMDEF, ENDPARAMDEF, BEGCURVE, ENDCURVE", "comments")


def test_cards_of_sms_go_to_gmsh_and_back(put, tmp_path):
    mesh = read_mesh(put("a.2dm", SMS))
    with pytest.warns(MeshWarning, match="SMS cards"):
        write_mesh(tmp_path / "a.msh", mesh)
    write_mesh(tmp_path / "b.2dm", read_mesh(tmp_path / "a.msh"))
    text = (tmp_path / "b.2dm").read_text()
    for row in ("E4Q 1 1 2 5 4 7", "ND 3 2.0 0.0 -2.5", 'NS 1 2 -3 9 "shore"', 'MAT 7 "left part"'):
        assert f"{row}\n" in text
    back = read_mesh(tmp_path / "b.2dm").source
    assert back.names == mesh.source.names
    assert back.blocks[-1][1].tolist() == [[7]]


def test_long_node_strings_are_written_over_lines(tmp_path):
    n = 40
    points = [(k, j) for j in (0, 1) for k in range(n)]
    mesh = Mesh(points, [(k, k + 1, n + k + 1, n + k) for k in range(n - 1)])
    content = of_mesh(mesh)
    content.blocks = [*content.blocks, ("line", np.array([(k, k + 1) for k in range(n - 1)]))]
    from qsmooth.io import sms

    data = sms.write(content)
    assert max(map(len, data.splitlines())) < 60
    assert data.count(b"NS ") == 4
    assert sms.read(data).blocks[-1][1].tolist() == [[k, k + 1] for k in range(n - 1)]


# Two squares with a slit, a weir, between: 0 1 4 3 left and 2 6 7 5 right.
WEIR = """! a title, with a mark
2 8  NE NP
1 0.0 0.0 1.0
2 1.0 0.0 1.0 ! south, left
3 1.1 0.0 1.0
4 0.0 1.0 1.0
5 1.0 1.0 1.0
6 1.1 1.0 1.0
7 2.0 0.0 1.0
8 2.0 1.0 1.0
1 4 1 2 5 4
2 4 3 7 8 6

! the boundaries
1 ! open
2 ! nodes of it
2 0
1
4
3 = Number of land boundaries
{total}
2 24
2 3 1.5 1.0 1.0
5 6 1.5 1.0 1.0   ! paired
2 23
7 2.5 1.0
8 2.5 1.0
3 21 an island, of a kind
1
2
5
"""


@pytest.mark.parametrize("total", [7, 9])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_weirs_have_two_sides_and_stay(put, total, newline):
    path = put("fort.14", WEIR.format(total=total).replace("\n", newline))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mesh = read_mesh(path)
    source = mesh.source
    assert source.blocks[1][0] == "line"
    edges = [[0, 3], [1, 4], [2, 5], [6, 7], [0, 1], [1, 4], [4, 0]]
    assert source.blocks[1][1].tolist() == edges
    assert source.tags[1].tolist() == [1, 2, 2, 3, 4, 4, 4]
    assert list(source.names) == ["open_1", "weir_1", "barrier_2", "island_3"]
    assert source.extras == ("types of boundaries", "figures of barriers", "comments")
    assert np.flatnonzero(mesh.topology.given_fixed).tolist() == [1, 2, 4, 5, 6, 7]


def test_a_wrong_total_of_boundary_nodes_is_said(put):
    with pytest.warns(MeshWarning, match="5 nodes are declared on land boundaries, 7 are listed"):
        read_mesh(put("fort.14", WEIR.format(total=5)))


def test_boundaries_are_written_as_sections(tmp_path):
    """A ring of four quads: the outer boundary in two parts, the hole an island."""
    outer = [(0, 0), (3, 0), (3, 3), (0, 3)]
    hole = [(1, 1), (2, 1), (2, 2), (1, 2)]
    mesh = Mesh([*outer, *hole], [(k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)])
    content = of_mesh(mesh)
    lines = np.array([(2, 1), (0, 1), (3, 2), (0, 3), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4)])
    content.blocks = [*content.blocks, ("line", lines)]
    content.tags = [np.zeros(4, int), np.array([1, 1, 2, 2, 3, 3, 3, 3, 4])]
    content.names = {"Open sea": (2, 1)}
    from qsmooth.io import adcirc

    rows = [row.split("!")[0].split() for row in adcirc.write(content).decode().splitlines()[14:]]
    flat = [" ".join(row) for row in rows]
    assert flat == [
        "1",
        "3",
        "3",
        "3",
        "4",
        "1",
        "2",
        "8",
        "3 0",
        "1",
        "2",
        "3",
        "5 1",
        "6",
        "5",
        "8",
        "7",
        "6",
    ]
    assert content.extras == ("1 line cells that are not on the boundary",)


def test_a_grid_without_boundaries_gets_none(tmp_path):
    mesh = Mesh(POINTS[:6], [(0, 1, 4, 3), (1, 2, 5, 4)])
    write_mesh(tmp_path / "a.gr3", mesh)
    tail = (tmp_path / "a.gr3").read_text().splitlines()[-4:]
    assert [row.split()[0] for row in tail] == ["0", "0", "0", "0"]


def test_a_title_may_be_empty_or_look_like_counts(put):
    for title in ("", "3 8", "2 quads, 1 triangle", "! none"):
        text = ADCIRC.replace("plate ! by hand", title)
        assert len(read_mesh(put("fort.14", text)).points) == 8, title
        assert len(read_mesh(put("a.grd", text)).points) == 8, title


@pytest.mark.parametrize(
    ("projection", "geographic"),
    [
        ("LONG/LAT", True),
        ("UTM-33", False),
        ('PROJCS["UTM 33",GEOGCS["WGS 84"]]', False),
        ('"GEOGCS["WGS 84"]"', True),
    ],
)
@pytest.mark.parametrize("head", ["100079 1000 8  ", " 8 "])
def test_headers_of_mike(put, tmp_path, projection, geographic, head):
    path = put("a.mesh", MIKE.replace("100079 1000 8 UTM-33", head + projection))
    mesh = read_mesh(path)
    assert mesh.source.format == "mike"
    assert mesh.source.geographic == geographic
    assert mesh.source.point_data["mike:code"].tolist() == [0, 1, 0, 1, 0, 1, 0, 1]
    write_mesh(tmp_path / "out.mesh", mesh)
    assert (tmp_path / "out.mesh").read_bytes() == path.read_bytes()


def test_mike_from_arrays_has_land_on_the_boundary(tmp_path):
    mesh = Mesh(XY, QUADS)
    write_mesh(tmp_path / "a.mesh", mesh, format="mike")
    assert (tmp_path / "a.mesh").read_text().startswith("100079 1000 25 NON-UTM\n")
    codes = read_mesh(tmp_path / "a.mesh").source.point_data["mike:code"]
    assert np.array_equal(codes == 1, mesh.topology.is_boundary)


def test_chains_join_edges_in_any_order():
    found = chains(np.array([(5, 6), (1, 2), (7, 5), (2, 3), (6, 7), (9, 8)]))
    assert sorted(chain.tolist() for chain in found) == [[1, 2, 3], [5, 6, 7, 5], [9, 8]]
    assert chains(np.empty((0, 2), np.int64)) == []
    figure_eight = np.array([(0, 1), (1, 2), (2, 0), (0, 3), (3, 4), (4, 0)])
    assert [chain.tolist() for chain in chains(figure_eight)] == [[0, 1, 2, 0, 3, 4, 0]]


def test_the_boundary_has_the_mesh_on_its_left_though_cells_run_clockwise():
    for cells in ([(0, 1, 4, 3), (1, 2, 5, 4)], [(3, 4, 1, 0), (1, 2, 5, 4)]):
        edges = boundary_edges(of_mesh(Mesh(POINTS[:6], cells)))
        expected = {(0, 1), (1, 2), (2, 5), (5, 4), (4, 3), (3, 0)}
        assert {(a, b) for a, b in edges.tolist()} == expected


@pytest.mark.parametrize("name", ["a.2dm", "a.14", "mike", "selafin"])
def test_cells_of_new_files_run_counter_clockwise(tmp_path, name):
    points = np.round(POINTS[:6])
    mesh = Mesh(points, [(3, 4, 1, 0), (1, 2, 5, 4)])
    ending, form = (".out", name) if "." not in name else (name[1:], None)
    write_mesh(tmp_path / f"a{ending}", mesh, format=form)
    back = read_mesh(tmp_path / f"a{ending}", format=form)
    assert back.cells[0].tolist() == [[3, 0, 1, 4], [1, 2, 5, 4]]


def test_a_tilted_plane_is_said_to_be_lost(tmp_path):
    xy = np.array(POINTS[:6], float)
    tilted = Mesh(np.column_stack((xy, xy[:, 0])), [(0, 1, 4, 3), (1, 2, 5, 4)])
    with pytest.warns(MeshWarning, match="the tilt of the mesh's plane"):
        write_mesh(tmp_path / "a.2dm", tilted)
    flat = Mesh(tilted.points, tilted.cells, surface="flat")
    write_mesh(tmp_path / "b.2dm", flat)
    assert np.array_equal(read_mesh(tmp_path / "b.2dm").points, flat.points)


def test_latin_1_and_other_cards_stay(put, tmp_path):
    content = SMS.encode().replace(b'"shore"', b'"K\xfcste"') + 'GP 1 "Kuste"\r\n'.encode("latin-1")
    mesh = read_mesh(put("a.2dm", content))
    assert "Küste" in mesh.source.names
    points = mesh.points.copy()
    points[4] += 0.01
    write_mesh(tmp_path / "b.2dm", mesh.with_points(points))
    back = (tmp_path / "b.2dm").read_bytes()
    assert [a for a, b in zip(content.splitlines(), back.splitlines(), strict=True) if a != b] == [
        b"ND 45 1.1 0.9 -2.5"
    ]


def test_second_order_of_sms_is_refused(put):
    with pytest.raises(MeshError, match=re.escape("1 of type quad8 (second order or higher)")):
        read_mesh(put("a.2dm", SMS + "E8Q 9 5 15 25 35 45 55 65 75 1\n"))


# ------------------------------------------------------------------------------- real files

FIGURES = re.compile(r"\|(\S+)\|[^|]*\|(\d+)v((?: \d+[tq])+)\|([^|]*)\|([\d.]+)/([\d.]+)\|")
ENDINGS = (".2dm", ".14", ".gr3")


def table(folder) -> dict[str, tuple[int, int, int, str, float, float]]:
    rows = {}
    for name, n, cells, boundary, low, high in FIGURES.findall((folder / "README.md").read_text()):
        if name.endswith(ENDINGS) or name.startswith("mike"):
            counts = {kind: int(count) for count, kind in re.findall(r"(\d+)([tq])", cells)}
            rows[name] = (
                int(n),
                counts.get("t", 0),
                counts.get("q", 0),
                boundary,
                float(low),
                float(high),
            )
    return rows


def angles(points, blocks) -> np.ndarray:
    found = []
    for cells in blocks:
        p = points[cells, :2]
        ahead, back = np.roll(p, -1, axis=1) - p, np.roll(p, 1, axis=1) - p
        cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
        found.append(np.degrees(np.arctan2(cross, (ahead * back).sum(axis=-1))).ravel() % 360)
    return np.concatenate(found)


def read_more(path):
    """Read a file; what is odd about the one is said."""
    if path.name == "schimpy_mixed.gr3":
        with pytest.warns(MeshWarning, match="45 nodes are declared on land boundaries, 48 are"):
            return read_mesh(path)
    return read_mesh(path)


def test_real_files_have_the_figures_of_their_table(shared_meshes):
    folder = shared_meshes / "more"
    if not folder.is_dir():
        pytest.skip("the folder of more formats is not here")
    rows = table(folder)
    assert len(rows) == 10
    for name, (n, triangles, quads, boundary, low, high) in rows.items():
        mesh = read_more(folder / name)
        sizes = {size: sum(len(c) for c in mesh.cells if c.shape[1] == size) for size in (3, 4)}
        assert (len(mesh.points), sizes[3], sizes[4]) == (n, triangles, quads), name
        found = angles(mesh.points, mesh.cells)
        assert (round(found.min(), 2), round(found.max(), 2)) == pytest.approx(
            (low, high), abs=0.0051
        )
        names = mesh.source.names
        if counts := re.match(r"(\d+) open, (\d+) land", boundary):
            n_open = sum(name.startswith("open") for name in names)
            assert (n_open, len(names) - n_open) == tuple(map(int, counts.groups())), name
        elif strings := re.search(r"(\d+) (?:named )?NS", boundary):
            marks = np.concatenate([tags for _, tags in mesh.source.of_type("line")])
            assert len(np.unique(marks)) == int(strings[1]), name
        elif boundary.startswith("codes"):
            codes = np.unique(mesh.source.point_data["mike:code"]).tolist()
            expected = {"codes 0-2": [0, 1, 2], "codes 0,1": [0, 1], "codes 0,1,3,5": [0, 1, 3, 5]}
            assert codes == expected[boundary], name


def test_real_files_that_are_known_in_another_format_too(shared_meshes):
    folder = shared_meshes / "more"
    if not folder.is_dir():
        pytest.skip("the folder of more formats is not here")
    for name, other in (
        ("river_mixed_materials.2dm", "river_mixed_z.obj"),
        ("mike_odense_mixed_oldheader.mesh", "odense_mixed_z.obj"),
    ):
        mesh, same = read_mesh(folder / name), read_mesh(shared_meshes / other, surface="flat")
        np.testing.assert_allclose(mesh.points, same.points, rtol=1e-12)
        cells, others = (
            sorted(tuple(row) for block in of.cells for row in block.tolist())
            for of in (mesh, same)
        )
        assert cells == others
    river = read_mesh(folder / "river_mixed_materials.2dm")
    assert np.unique(river.regions).tolist() == [1, 2, 3]
    assert river.source.names["channel mid"] == (3, 2)


def test_real_files_change_in_coordinates_only(shared_meshes, tmp_path):
    folder = shared_meshes / "more"
    if not folder.is_dir():
        pytest.skip("the folder of more formats is not here")
    for name in table(folder):
        mesh = read_more(folder / name)
        path = tmp_path / name
        write_mesh(path, mesh)
        data = (folder / name).read_bytes()
        assert path.read_bytes() == data, name
        points = mesh.points.copy()
        chosen = np.random.default_rng(1).choice(len(points), len(points) // 3, replace=False)
        points[chosen] += 1e-7
        write_mesh(path, mesh.with_points(points))
        back = read_more(path)
        assert np.array_equal(back.points, points), name
        before, after = data.splitlines(keepends=True), path.read_bytes().splitlines(keepends=True)
        differ = [(a, b) for a, b in zip(before, after, strict=True) if a != b]
        assert len(differ) == len(chosen), name
        for a, b in differ:
            x, y = a.split(), b.split()
            assert sum(p != q for p, q in zip(x, y, strict=True)) == 3, name
