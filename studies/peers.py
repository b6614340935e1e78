"""Run qsmooth beside other smoothers on the same meshes, all in one run.

    python studies/peers.py                          # what is installed, meshes of 2K cells
    python studies/peers.py --size 24000 --repeat 1 --limit 300
    python studies/peers.py --peer mfem --mesh fold --python /path/to/another/python

Every run has a process of its own with a time limit, as some libraries end the process on meshes
they can't handle. A small mesh goes through first, so that nothing is compiled or loaded in the
time that counts: that of the smoothing call alone, the median of the repetitions, each on a mesh
given anew. Connectivity and boundary are held by all of them. Quality is measured here, by one
piece of code for all. A peer that is not installed is skipped.

The peers: gmsh's UntangleMeshGeometry (a regularised Winslow energy), MFEM's TMOP (the shape metric
2 with Newton and MINRES; where the mesh is not valid first metric 4 with a shifted barrier), and
VTK's vtkSmoothPolyDataFilter (100 sweeps of Laplacian smoothing, which guards nothing).
"""

import argparse
import importlib.util
import json
import math
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path

import numpy as np

MESHES = ("square", "tangled", "random", "notch", "fold", "lake", "triangles")
PEERS = {"qsmooth": "qsmooth", "gmsh": "gmsh", "mfem": "mfem", "vtk": "vtk"}

# ------------------------------------------------------------------------------- meshes


def make(name, size):
    """Points (n, 2) and cells (m, 4) or (m, 3), counter-clockwise, of about `size` cells."""
    from qsmooth import examples

    n = max(4, round(math.sqrt(size)))
    if name == "square":
        mesh = examples.jittered(n, n, seed=1)
    elif name == "tangled":
        mesh = examples.tangled(n, n, amount=1.0, seed=1)
    elif name == "random":
        mesh = examples.random_interior(n, n, seed=1)
    elif name == "lake":
        mesh = examples.lake(max(1000, size))
    elif name == "triangles":
        mesh = examples.random_triangles(2 * (size // 2), seed=1)
    else:
        mesh = notch(n)
        if name == "fold":
            mesh = mesh.with_points(harmonic(mesh))
        else:
            mesh = shaken(mesh)
    width = 3 if name == "triangles" else 4
    return mesh.points, mesh.cell_vertices.reshape(-1, width)


def notch(n):
    """A square of n by n quads with a deep smooth bump in its bottom."""
    from qsmooth import examples

    mesh = examples.structured(n, n)
    x, y = mesh.points.T

    def height(x):
        return 0.7 * np.exp(-(((x - 0.5) / 0.13) ** 2))

    low = height(x) - height(0.0)
    return mesh.with_points(np.stack([x, low + (1.0 - low) * y], axis=1))


def shaken(mesh):
    """Move the interior vertices at random, as far as every cell stays valid."""
    cells = mesh.cell_vertices.reshape(-1, 4)
    sides = mesh.points[np.roll(cells, -1, axis=1)] - mesh.points[cells]
    lengths = np.hypot(sides[..., 0], sides[..., 1])
    shortest = np.full(mesh.n_vertices, np.inf)
    for corners in (cells, np.roll(cells, -1, axis=1)):
        np.minimum.at(shortest, corners, lengths)
    moves = np.random.default_rng(8).uniform(-0.4, 0.4, mesh.points.shape) * shortest[:, None]
    moves[mesh.is_boundary] = 0.0
    for _ in range(60):
        bad = measure(mesh.points + moves, cells)["sines"] < 0.02
        if not bad.any():
            break
        moves[cells[bad]] *= 0.5
    return mesh.with_points(mesh.points + moves)


def harmonic(mesh):
    """Points with every interior vertex at the mean of its neighbours: folded at the bump's tip."""
    from scipy.sparse import csr_matrix, diags
    from scipy.sparse.linalg import spsolve

    n, offsets = mesh.n_vertices, mesh.ring_offsets
    ring = csr_matrix((np.ones(offsets[-1]), mesh.ring_vertices, offsets), shape=(n, n))
    matrix = (diags(np.diff(offsets).astype(float)) - ring).tocsr()[~mesh.is_boundary]
    points = mesh.points.copy()
    right = -matrix[:, mesh.is_boundary] @ points[mesh.is_boundary]
    points[~mesh.is_boundary] = spsolve(matrix[:, ~mesh.is_boundary].tocsc(), right)
    return points


def sides_of(cells):
    return np.stack([cells, np.roll(cells, -1, axis=1)], axis=2).reshape(-1, 2)


def boundary_sides(cells):
    """Sides with one cell, as they run in it."""
    sides = sides_of(cells)
    _, inverse, counts = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return sides[counts[inverse.ravel()] == 1]


def boundary_of(cells, n):
    mask = np.zeros(n, bool)
    mask[boundary_sides(cells).ravel()] = True
    return mask


def boundary_loops(points, cells):
    """Closed loops of boundary vertices, that round all the others first."""
    after = dict(boundary_sides(cells).tolist())
    loops = []
    while after:
        loop = [next(iter(after))]
        while (following := after.pop(loop[-1])) != loop[0]:
            loop.append(following)
        loops.append(loop)
    return sorted(loops, key=lambda loop: -float(np.ptp(points[loop], axis=0).prod()))


def measure(points, cells):
    """Corner sines and angles: smallest angle, scaled Jacobians, cells with a corner that is flat
    or turned.
    """
    u = points[np.roll(cells, -1, axis=1)] - points[cells]
    w = points[np.roll(cells, 1, axis=1)] - points[cells]
    det = u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]
    dot = (u * w).sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        sines = det / np.sqrt((u * u).sum(axis=-1) * (w * w).sum(axis=-1))
    scaled = sines.min(axis=1) * (2.0 / math.sqrt(3.0) if cells.shape[1] == 3 else 1.0)
    return {
        "sines": sines.min(axis=1),
        "angle": float((np.degrees(np.arctan2(det, dot)) % 360.0).min()),
        "worst": float(scaled.min()),
        "mean": float(scaled.mean()),
        "invalid": int((~(det > 0.0)).any(axis=1).sum()),
    }


# ------------------------------------------------------------------------------- peers
# Each takes points and cells, and gives back a call to be timed and one for the points it made.


def start_qsmooth(points, cells):
    from qsmooth import Mesh, smooth

    mesh, results = Mesh(points, cells), []
    return lambda: results.append(smooth(mesh)), lambda: results[0].points


def start_vtk(points, cells):
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray, vtk_to_numpy

    coordinates = vtk.vtkPoints()
    coordinates.SetDataTypeToDouble()
    flat = np.column_stack([points, np.zeros(len(points))])
    coordinates.SetData(numpy_to_vtk(flat, deep=True))
    polygons = vtk.vtkCellArray()
    offsets = np.arange(len(cells) + 1) * cells.shape[1]
    polygons.SetData(
        numpy_to_vtkIdTypeArray(offsets, deep=True),
        numpy_to_vtkIdTypeArray(cells.ravel(), deep=True),
    )
    surface = vtk.vtkPolyData()
    surface.SetPoints(coordinates)
    surface.SetPolys(polygons)
    smoother = vtk.vtkSmoothPolyDataFilter()
    smoother.SetInputData(surface)
    smoother.SetNumberOfIterations(100)
    smoother.SetRelaxationFactor(0.5)
    smoother.SetConvergence(0.0)
    smoother.BoundarySmoothingOff()
    smoother.FeatureEdgeSmoothingOff()
    smoother.SetOutputPointsPrecision(vtk.vtkAlgorithm.DOUBLE_PRECISION)
    return (
        smoother.Update,
        lambda: vtk_to_numpy(smoother.GetOutput().GetPoints().GetData())[:, :2],
    )


def start_gmsh(points, cells):
    """A plane surface bounded by one line a side, as gmsh moves nothing without parameters."""
    import gmsh

    if gmsh.isInitialized():
        gmsh.finalize()
    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.model.add("mesh")
    model, mesh = gmsh.model.geo, gmsh.model.mesh
    xyz = np.column_stack([points, np.zeros(len(points))])
    loops, curves = boundary_loops(points, cells), []
    for loop in loops:
        for v in loop:
            model.addPoint(*xyz[v], tag=v + 1)
        ends = zip(loop, loop[1:] + loop[:1], strict=True)
        curves.append([model.addLine(a + 1, b + 1) for a, b in ends])
    model.addPlaneSurface([model.addCurveLoop(lines) for lines in curves], 1)
    model.synchronize()
    for loop, lines in zip(loops, curves, strict=True):
        for v in loop:
            mesh.addNodes(0, v + 1, [v + 1], xyz[v])
        for line, a, b in zip(lines, loop, loop[1:] + loop[:1], strict=True):
            mesh.addElementsByType(line, 1, [], [a + 1, b + 1])
    inner = np.flatnonzero(~boundary_of(cells, len(points)))
    flat = xyz[inner].ravel()
    mesh.addNodes(2, 1, inner + 1, flat, gmsh.model.getParametrization(2, 1, flat))
    mesh.addElementsByType(1, 3 if cells.shape[1] == 4 else 2, [], (cells + 1).ravel())

    def result():
        # It numbers the nodes anew, and keeps the order of the cells.
        tags, coordinates, _ = mesh.getNodes()
        at = np.full((int(tags.max()) + 1, 3), np.nan)
        at[tags.astype(np.int64)] = coordinates.reshape(-1, 3)
        _, _, nodes = mesh.getElements(2)
        moved = points.copy()
        moved[cells.ravel()] = at[nodes[0].astype(np.int64), :2]
        return moved

    return lambda: mesh.optimize("UntangleMeshGeometry"), result


def start_mfem(points, cells):
    """TMOP as MFEM's mesh-optimizer does it, on a mesh scaled to a mean cell area of the ideal."""
    import mfem.ser as mfem

    n, quads = len(points), cells.shape[1] == 4
    at = points[cells]
    after = np.roll(at, -1, axis=1)
    area = 0.5 * (at[..., 0] * after[..., 1] - at[..., 1] * after[..., 0]).sum()
    scale = math.sqrt((1.0 if quads else 0.25 * math.sqrt(3.0)) * len(cells) / area)
    mesh = mfem.Mesh(2, n, len(cells))
    for x, y in (points * scale).tolist():
        mesh.AddVertex(x, y, 0.0)
    for cell in cells.tolist():
        (mesh.AddQuad if quads else mesh.AddTriangle)(*cell)
    mesh.FinalizeTopology()
    mesh.Finalize(False, False)
    elements = mfem.H1_FECollection(1, 2)
    space = mfem.FiniteElementSpace(mesh, elements, 2)
    mesh.SetNodalFESpace(space)
    nodes = mfem.GridFunction(space)
    mesh.SetNodalGridFunction(nodes)
    fixed = np.flatnonzero(boundary_of(cells, n))
    held = mfem.intArray(np.concatenate([fixed, fixed + n]).tolist())
    keep = mesh, elements, space, held

    def current():
        flat = nodes.GetDataArray()
        return np.column_stack([flat[:n], flat[n:]])

    def least():
        at = current()[cells]
        u, w = np.roll(at, -1, axis=1) - at, np.roll(at, 1, axis=1) - at
        det = float((u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]).min())
        return det if quads else det * 2.0 / math.sqrt(3.0)

    def run():
        if least() <= 0.0:
            _tmop(mfem, keep, nodes, least(), quads)
        if least() > 0.0:
            _tmop(mfem, keep, nodes, None, quads)

    return run, lambda: current() / scale


def _tmop(mfem, keep, nodes, least, quads):
    """One solve: of the shape metric, or with `least` of the one that untangles."""
    from mfem._ser import tmop, tmop_tools

    _, _, space, held = keep
    barrier = None
    if least is None:
        metric = tmop.TMOP_Metric_002()
    else:
        barrier = mfem.doublep()
        barrier.assign(least - 0.01 if least < 0.0 else 0.0)
        kind = tmop.TMOP_WorstCaseUntangleOptimizer_Metric
        base = tmop.TMOP_Metric_004()
        metric = kind(
            base, 1, 1.5, 0.001, 0.001, kind.BarrierType_Shifted, kind.WorstCaseType__None
        )
    target = tmop.TargetConstructor(tmop.TargetConstructor.IDEAL_SHAPE_UNIT_SIZE)
    start = mfem.GridFunction(space)
    start.Assign(nodes)
    target.SetNodes(start)
    # Points of order 3 are the corners, the sides' middles and the centre.
    rules = mfem.IntegrationRules(0, mfem.Quadrature1D.GaussLobatto)
    integrator = tmop.TMOP_Integrator(metric, target)
    integrator.SetIntegrationRules(rules, 3)
    if least is not None:
        integrator.ComputeUntangleMetricQuantiles(nodes, space)
    form = mfem.NonlinearForm(space)
    form.AddDomainIntegrator(integrator)
    integrator.thisown = False
    form.SetEssentialVDofs(held)
    rule = rules.Get(mfem.Geometry.SQUARE if quads else mfem.Geometry.TRIANGLE, 3)
    solver = tmop_tools.TMOPNewtonSolver(rule, 0)
    linear = mfem.MINRESSolver()
    linear.SetMaxIter(100)
    linear.SetRelTol(1e-12)
    linear.SetAbsTol(0.0)
    linear.SetPrintLevel(-1)
    solver.SetPreconditioner(linear)
    solver.SetIntegrationRules(rules, 3)
    if barrier is not None:
        solver.SetMinDetPtr(barrier.cast())
    solver.SetMaxIter(100 if least is None else 200)
    solver.SetRelTol(1e-5)
    solver.SetAbsTol(0.0)
    solver.SetPrintLevel(-1)
    solver.SetOperator(form)
    solver.Mult(mfem.Vector(0), nodes)


START = {"qsmooth": start_qsmooth, "gmsh": start_gmsh, "mfem": start_mfem, "vtk": start_vtk}

# ------------------------------------------------------------------------------- processes


def worker(peer, folder, name, repeat):
    """Run one peer on one mesh in this process; write what it made beside the mesh."""
    start = START[peer]
    for file in (f"{name}-small.npz", f"{name}.npz"):
        data = np.load(folder / file)
        seconds = []
        for _ in range(1 if "small" in file else repeat):
            run, result = start(data["points"].copy(), data["cells"].copy())
            begin = time.perf_counter()
            run()
            seconds.append(time.perf_counter() - begin)
            points = np.array(result())
    np.save(folder / f"{name}-{peer}.npy", points)
    print("SECONDS", json.dumps(seconds))


def installed(package, python):
    if python == sys.executable:
        return importlib.util.find_spec(package) is not None
    probe = f"import importlib.util as u, sys; sys.exit(u.find_spec({package!r}) is None)"
    return subprocess.run([python, "-c", probe], check=False).returncode == 0


def run_apart(arguments, python, limit):
    """Output of this script in a process of its own; the reason where there is none."""
    try:
        done = subprocess.run(
            [python, __file__, *map(str, arguments)],
            capture_output=True, text=True, timeout=limit, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None, f"over {limit:g} s"
    if done.returncode == 0:
        return done.stdout, ""
    last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
    return None, f"ended with {done.returncode}: {last[:60]}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--size", type=int, default=2000, help="about how many cells")
    parser.add_argument("--mesh", action="append", choices=MESHES, help="default: all")
    parser.add_argument("--peer", action="append", choices=PEERS, help="default: all")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--limit", type=float, default=120.0, help="seconds a process may take")
    parser.add_argument("--python", default=sys.executable, help="interpreter of the peers")
    parser.add_argument("--worker", nargs=4, help=argparse.SUPPRESS)
    parser.add_argument("--make", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        peer, folder, name, repeat = options.worker
        worker(peer, Path(folder), name, int(repeat))
        return
    if options.make:
        folder, name, size = options.make
        for file, cells in ((f"{name}-small.npz", 64), (f"{name}.npz", int(size))):
            points, made = make(name, cells)
            np.savez(Path(folder) / file, points=points, cells=made)
        return
    pythons = {p: sys.executable if p == "qsmooth" else options.python for p in PEERS}
    wanted = options.peer or list(PEERS)
    peers = [p for p in PEERS if p in {"qsmooth", *wanted} and installed(PEERS[p], pythons[p])]
    missing = [p for p in wanted if p not in peers]
    print(
        f"{platform.machine()}, Python {platform.python_version()}, numpy {np.__version__}; "
        f"median of {options.repeat}, warm; not installed: {', '.join(missing) or 'none'}"
    )
    head = ("mesh", "cells", "smoother", "seconds", "ratio", "smallest", "min SJ", "mean SJ", "bad")
    print("{:10} {:>7} {:9} {:>9} {:>7} {:>8} {:>7} {:>7} {:>6}".format(*head))
    ratios = defaultdict(list)
    with tempfile.TemporaryDirectory() as name_of_folder:
        folder = Path(name_of_folder)
        for name in options.mesh or MESHES:
            run = "--make", folder, name, options.size
            _, why = run_apart(run, sys.executable, options.limit)
            if why:
                print(f"{name:10} was not made: {why}")
                continue
            compare(folder, name, peers, pythons, options, ratios)
    for peer, values in ratios.items():
        print(
            f"{peer}: {min(values):.2g} to {max(values):.2g} times qsmooth's time, "
            f"geometric mean {math.exp(statistics.fmean(map(math.log, values))):.2g}"
        )


def compare(folder, name, peers, pythons, options, ratios):
    """Print the lines of one mesh."""
    data = np.load(folder / f"{name}.npz")
    points, cells = data["points"], data["cells"]
    start = f"{name:10} {len(cells):7}"
    print(line(start, "(input)", "", "", measure(points, cells)))
    own = math.nan
    fixed = boundary_of(cells, len(points))
    for peer in peers:
        run = "--worker", peer, folder, name, options.repeat
        output, why = run_apart(run, pythons[peer], options.limit)
        if output is None:
            print(f"{start} {peer:9} {why}", flush=True)
            continue
        text = next(t for t in output.splitlines() if t.startswith("SECONDS "))
        seconds = statistics.median(json.loads(text[8:]))
        made = np.load(folder / f"{name}-{peer}.npy")
        if peer == "qsmooth":
            own = seconds
        else:
            ratios[peer].append(seconds / own)
        note = ""
        if not np.allclose(made[fixed], points[fixed], rtol=0.0, atol=1e-6 * np.ptp(points)):
            note = "  moved the boundary"
        ratio = f"{seconds / own:.2g}"
        print(line(start, peer, f"{seconds:.4f}", ratio, measure(made, cells)) + note, flush=True)


def line(start, peer, seconds, ratio, found):
    return (
        f"{start} {peer:9} {seconds:>9} {ratio:>7} {found['angle']:8.2f} {found['worst']:7.3f} "
        f"{found['mean']:7.3f} {found['invalid']:6}"
    )


if __name__ == "__main__":
    main()
