"""Run by several ranks: that each result has the bits that one process gives. Prints JSON."""

import json
import sys
import traceback
from pathlib import Path

import numpy as np
from mpi4py import MPI

sys.path.insert(0, str(Path(__file__).parent.parent))

from mesh_parts import all_on_the_first, blocks_of_rows, cell_corners, part_of, round_robin

import meshes
from qsmooth import Mesh, Smoother, compare, engine, parts, smooth, team, untangle
from qsmooth.examples import boundary_layer, bump, lake, structured, tangled
from qsmooth.kernels.blocks import LANES
from qsmooth.numbering import numbered
from qsmooth.registry import methods

engine.LEAST_DIVIDED = 0  # small meshes are divided, too
comm = MPI.COMM_WORLD


def unstructured(kind, seed=3):
    """Irregular cells, near to tangled."""
    return meshes.random_mesh(kind, 10, seed=seed, amount=0.4).mesh


def two_regions():
    """A line between two regions, on which vertices stay or slide."""
    made = meshes.random_mesh("mixed", 10, seed=5, amount=0.3).mesh
    middle = np.median(made.points[:, 0])
    corners = np.add.reduceat(made.points[made.cell_vertices, 0], made.cell_offsets[:-1])
    sizes = np.diff(made.cell_offsets)
    return Mesh(made.points, made.cells, regions=(corners / sizes > middle).astype(int))


def scattered():
    """A mesh that is put into another order inside."""
    made = structured(20, 20)
    rng = np.random.default_rng(2)
    points = made.points + rng.uniform(-0.01, 0.01, made.points.shape)
    points[made.is_boundary] = made.points[made.is_boundary]
    order = rng.permutation(made.n_vertices)
    shuffled, places = points[order], np.argsort(order)
    return Mesh(shuffled, [places[rng.permutation(made.cells[0])]])


def with_depth():
    """A third coordinate is a value that is interpolated."""
    made = unstructured("quads")
    z = np.sin(3 * made.points[:, 0]) * made.points[:, 1]
    return Mesh(np.column_stack([made.points, z]), made.cells, surface="flat")


MESHES = {
    "structured": lambda: meshes_of_rough_grid(),
    "quads": lambda: unstructured("quads"),
    "triangles": lambda: unstructured("triangles"),
    "mixed": lambda: unstructured("mixed"),
    "tangled": lambda: tangled(12, 12, amount=1.2, seed=1),
    "regions": two_regions,
    "bump": lambda: bump(24),
    "layer": lambda: boundary_layer(20, 10, first=1e-3),
    "lake": lambda: lake(1000),
    "scattered": scattered,
    "depth": with_depth,
}


def meshes_of_rough_grid():
    """A structured mesh with rough places."""
    points, cells = meshes.rough_grid(14)
    return Mesh(points, cells)


OPTIONS = [
    ("quads", "star", {"worst_fraction": 0.3}),
    ("quads", "star", {"worst_fraction": 0.3, "worst_first": True, "max_sweeps": 9}),
    ("mixed", "quad", {"bad_angle": 140.0, "bad_step": 0.5}),
    ("quads", "star", {"split_quads": "shorter"}),
    ("quads", "aspect-ratio", {"split_quads": "first"}),
    ("mixed", "laplacian", {"weights": "area"}),
    ("mixed", "smart-laplacian", {"weights": "area"}),
    ("triangles", "angle", {"guard": "none"}),
    ("quads", "star", {"guard": "clearance", "rtol": 0.0}),
    ("quads", "star", {"boundary": "slide"}),
    ("lake", "optimize", {"boundary": "slide", "max_sweeps": 200}),
    ("regions", "optimize", {"interfaces": "slide", "max_sweeps": 200}),
    ("regions", "star", {"keep_interfaces": False}),
    ("mixed", "star", {"max_move": 0.02}),
    ("mixed", "optimize", {"max_move_share": 0.3, "directions": (1.0, 0.0)}),
    ("quads", "optimize", {"selection": "max_angle > 120", "selection_rings": 2}),
    ("quads", "star", {"fixed": "x < 0.5"}),
    ("layer", "optimize", {"target": "initial"}),
    ("layer", "optimize", {"objective": "shape-size", "max_sweeps": 100}),
    ("bump", "optimize", {"target": "ideal"}),
    ("lake", "optimize", {"hold": "min_edge,shape"}),
    ("tangled", "optimize", {"hold": "aspect_ratio"}),
    ("depth", "star", {}),
    ("depth", "optimize", {"carry": "keep"}),
    ("scattered", "star", {}),
    ("scattered", "optimize", {}),
    ("quads", "optimize", {"threads": 2}),
    ("quads", "optimize", {"max_sweeps": 7}),
    ("quads", "star", {"max_sweeps": 0}),
]


def told(result):
    """All that has to be alike."""
    return (
        result.points.tobytes(),
        [record.__dict__ for record in result.history],
        result.reason,
        result.sweeps,
    )


def same(alone, together):
    """Whether all ranks have what one process has."""
    return bool(comm.allreduce(told(alone) == told(together), MPI.MIN))


def on_first(mesh):
    """Only the first rank has the mesh."""
    return mesh if comm.rank == 0 else None


def every_method():
    for name, make in MESHES.items():
        mesh = make()
        for method in methods():
            if methods()[method]().why_not(mesh):
                continue
            yield (
                f"{name} {method}",
                same(smooth(mesh, method), smooth(on_first(mesh), method, comm=comm)),
            )


def every_option():
    for name, method, options in OPTIONS:
        mesh = MESHES[name]()
        alone = smooth(mesh, method, **options)
        yield (
            f"{name} {method} {options}",
            same(alone, smooth(on_first(mesh), method, comm=comm, **options)),
        )
    mesh = MESHES["quads"]()
    for how in ("kept", "curve"):
        with numbered(how):
            yield f"numbered {how}", same(smooth(mesh, "star"), smooth(mesh, "star", comm=comm))

    def metric(places):
        return np.broadcast_to(np.diag([100.0, 400.0]), (len(places), 2, 2)).copy()

    options = {"target": metric, "max_sweeps": 60}
    yield "metric", same(smooth(mesh, **options), smooth(on_first(mesh), comm=comm, **options))


def every_partition():
    for name in ("structured", "quads", "mixed", "regions", "tangled", "scattered"):
        mesh = MESHES[name]()
        for partition in (blocks_of_rows, round_robin):
            for ghosts in (False, True):
                part = part_of(mesh, partition(mesh, comm.size), comm, ghosts=ghosts)
                for method in ("star", "quad", "laplacian", "optimize"):
                    alone = smooth(mesh, method)
                    together = smooth(part, method)
                    is_same = same(alone, together.whole)
                    own = np.array_equal(together.points, alone.points[part.vertex_ids])
                    is_same &= bool(comm.allreduce(own, MPI.MIN))
                    yield f"{name} {method} {partition.__name__} {ghosts}", is_same

    for mesh in (structured(1, 1), structured(2, 2), MESHES["quads"]()):
        part = part_of(mesh, all_on_the_first(mesh, comm.size), comm)
        for method in ("star", "laplacian", "optimize"):
            alone = smooth(mesh, method)
            is_same = same(alone, smooth(part, method).whole)
            is_same &= same(alone, smooth(on_first(mesh), method, comm=comm))
            yield f"{mesh.n_cells} cells, {method}, all on the first", is_same


def ways_in():
    mesh, broken = MESHES["mixed"](), MESHES["tangled"]()
    yield "untangle", same(untangle(broken), untangle(on_first(broken), comm=comm))
    part = part_of(broken, round_robin(broken, comm.size), comm)
    yield "untangle parts", same(untangle(broken), untangle(part).whole)
    alone, skipped = compare(mesh)
    together, skipped_together = compare(on_first(mesh), comm=comm)
    each = [same(alone[k], together[k]) for k in alone]  # all ranks ask each time
    same_names = list(alone) == list(together) and skipped == skipped_together
    yield "compare", same_names and all(each)
    seen = []

    def stop_at_three(record):
        seen.append(record)
        return len(seen) == 3

    first = smooth(mesh, "star", callback=stop_at_three)
    n_seen = len(seen)
    seen.clear()
    second = smooth(on_first(mesh), "star", callback=stop_at_three, comm=comm)
    yield "callback", same(first, second) and len(seen) == (n_seen if comm.rank == 0 else 0)
    limited = smooth(mesh, "star", time_limit=1e-3, rtol=0.0, max_sweeps=10**6, comm=comm)
    alike = comm.allgather((limited.points.tobytes(), limited.sweeps))
    yield "time limit", len(set(alike)) == 1 and limited.sweeps < 10**6


SESSIONS = [
    ("mixed", "star", {}),
    ("mixed", "optimize", {}),
    ("mixed", "laplacian", {}),
    ("mixed", "quad", {}),
    ("mixed", "smart-laplacian", {}),
    ("triangles", "aspect-ratio", {}),
    ("triangles", "angle", {}),
    ("tangled", "optimize", {}),
    ("tangled", "star", {}),
    ("layer", "optimize", {}),
    ("scattered", "optimize", {}),
    ("depth", "star", {}),
    ("quads", "star", {"split_quads": "shorter"}),
    ("quads", "star", {"boundary": "slide"}),
    ("quads", "star", {"max_move_share": 0.3}),
    ("lake", "optimize", {"boundary": "slide"}),
    ("regions", "optimize", {"interfaces": "slide"}),
    ("regions", "optimize", {"hold": "aspect_ratio"}),
    ("regions", "optimize", {"worst": False, "selection": "region == 1"}),
]


def shaken(mesh, n_steps, amount=0.15):
    """Where the host has the vertices, step after step: some small, some that break cells."""
    rng = np.random.default_rng(7)
    edges = mesh.points[mesh.cells[0][:, 0], :2] - mesh.points[mesh.cells[0][:, 1], :2]
    length = float(np.median(np.hypot(*edges.T)))
    for k in range(n_steps):
        moves = np.zeros(mesh.points.shape)
        few = rng.choice(mesh.n_vertices, mesh.n_vertices // 10, replace=False)
        moves[few, :2] = rng.normal(0, amount * length * (1 + k % 3), (few.size, 2))
        moves[mesh.is_boundary, 0] = 0.02 * length
        yield moves


def sessions():
    for name, method, options in SESSIONS:
        mesh = MESHES[name]()
        few = name == "mixed" and method != "quad"
        every = (blocks_of_rows, round_robin, all_on_the_first) if few else (round_robin,)
        for partition in (None, *(() if name == "depth" else every)):
            part = None if partition is None else part_of(mesh, partition(mesh, comm.size), comm)
            alone = Smoother(mesh, method, **options)
            if part is None:
                together, rows = Smoother(on_first(mesh), method, comm=comm, **options), slice(None)
            else:
                together, rows = Smoother(part, method, **options), part.vertex_ids
            points, good = mesh.points.copy(), True
            for moves in shaken(mesh, 5):
                points = points + moves
                mine = points[rows].copy() if part is not None or comm.rank == 0 else None
                record, own = alone.step(points), together.step(mine)
                good &= record == own and (mine is None or np.array_equal(mine, points[rows]))
            mine = points[rows] if part is not None or comm.rank == 0 else None
            good &= np.array_equal(alone(points).points[rows], together(mine).points)
            how = "whole" if partition is None else partition.__name__
            yield f"{name} {method} {options} {how}", bool(comm.allreduce(good, MPI.MIN))


def steps_are_divided():
    """Each rank sweeps about its share of the vertices in a step, not all of them."""
    mesh, swept = structured(90, 90), []
    moved = mesh.points + np.random.default_rng(1).normal(0, 2e-3, mesh.points.shape)
    usual = parts.Steps.sweep

    def counted(self, move, n_colours, xy):
        before = xy.copy()
        for colour in range(n_colours):
            self._run_range(move, colour)
        swept.append(int((xy != before).any(axis=1).sum()))
        xy[:] = before
        usual(self, move, n_colours, xy)

    parts.Steps.sweep = counted
    for method in ("star", "optimize"):
        swept.clear()
        Smoother(on_first(mesh), method, comm=comm).step(moved.copy())
        share = mesh.topology.schedule().vertices.size / comm.size
        fair = bool(swept) and max(swept) < 1.1 * share + 6 * LANES
        yield method, comm.size == 1 or bool(comm.allreduce(fair, MPI.MIN))
    parts.Steps.sweep = usual


def traffic():
    """What is sent in a sweep is what has to be: nothing twice, nothing that nobody waits for."""
    teams = []

    class Counted(team.Team):
        def __init__(self, comm):
            super().__init__(comm)
            teams.append(self)

    usual, team.Team = team.Team, Counted
    for name in ("structured", "mixed"):
        mesh = MESHES[name]()
        rows, stars = cell_corners(mesh), mesh.topology.schedule()
        colour, counts = np.full(mesh.n_vertices, -1), np.diff(stars.colour_offsets)
        colour[stars.vertices] = np.repeat(np.arange(counts.size), counts)
        for partition in (blocks_of_rows, round_robin):
            cell_rank = partition(mesh, comm.size)
            owner = np.full(mesh.n_vertices, comm.size)
            for row, rank in zip(rows, cell_rank, strict=True):
                owner[row[row >= 0]] = np.minimum(owner[row[row >= 0]], rank)
            pairs = {
                (int(v), int(owner[w]))
                for row in rows
                for v in row[row >= 0]
                for w in row[row >= 0]
                if colour[v] >= 0 and colour[w] >= 0 and owner[v] == comm.rank != owner[w]
            }
            messages = {(int(colour[v]), rank) for v, rank in pairs}
            teams.clear()
            smooth(part_of(mesh, cell_rank, comm), "star", max_sweeps=3, rtol=0.0)
            sent = sum(one.sent for one in teams), sum(one.messages for one in teams)
            good = sent == (3 * 16 * len(pairs), 3 * len(messages))
            yield f"{name} {partition.__name__}", bool(comm.allreduce(good, MPI.MIN))
    team.Team = usual


GROUPS = (
    every_method,
    every_option,
    every_partition,
    ways_in,
    sessions,
    steps_are_divided,
    traffic,
)

if __name__ == "__main__":
    found = {}
    try:
        for group in GROUPS:
            for case, good in group():
                found[f"{group.__name__}: {case}"] = bool(good)
    except Exception:
        traceback.print_exc()
        sys.stderr.flush()
        comm.Abort(3)
    if comm.rank == 0:
        print(json.dumps(found))
