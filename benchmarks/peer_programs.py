"""Smoothers of other projects, each with connectivity and boundary held, on one thread.

Each `start_…` takes points and cells, and gives back a call to be timed and one for the points that
came of it. Loading a mesh into a program's own structures is not timed.
"""

import math
from typing import NamedTuple

import numpy as np

from peer_meshes import boundary, boundary_loops, edges

SWEEPS = {"gmsh-relocate": 20, "vtk": 100, "scipy": 20}


def start_gmsh_untangle(points, cells):
    """A regularised Winslow energy; the best smoother that gmsh has."""
    return _start_gmsh(points, cells, "UntangleMeshGeometry", 1)


def start_gmsh_relocate(points, cells):
    return _start_gmsh(points, cells, "Relocate2D", SWEEPS["gmsh-relocate"])


def _start_gmsh(points, cells, method, sweeps):
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
    inner = np.flatnonzero(~boundary(cells, len(points)))
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

    return lambda: mesh.optimize(method, False, sweeps), result


def start_mfem(points, cells):
    """TMOP as MFEM's mesh-optimizer does it, on a mesh scaled to a mean cell area of the ideal.

    The shape metric 2, by Newton's method with MINRES; where the mesh is not valid first metric 4
    with a shifted barrier.
    """
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
    fixed = np.flatnonzero(boundary(cells, n))
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
            _solve_tmop(mfem, keep, nodes, least(), quads)
        if least() > 0.0:
            _solve_tmop(mfem, keep, nodes, None, quads)

    return run, lambda: current() / scale


def _solve_tmop(mfem, keep, nodes, least, quads):
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


def start_vtk(points, cells):
    """Laplacian smoothing without a guard, half the way a sweep."""
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
    smoother.SetNumberOfIterations(SWEEPS["vtk"])
    smoother.SetRelaxationFactor(0.5)
    smoother.SetConvergence(0.0)
    smoother.BoundarySmoothingOff()
    smoother.FeatureEdgeSmoothingOff()
    smoother.SetOutputPointsPrecision(vtk.vtkAlgorithm.DOUBLE_PRECISION)
    return (
        smoother.Update,
        lambda: vtk_to_numpy(smoother.GetOutput().GetPoints().GetData())[:, :2],
    )


def start_scipy(points, cells):
    """Jacobi sweeps of Laplacian smoothing, each a sparse product."""
    from scipy.sparse import csr_matrix

    n, pairs = len(points), edges(cells)
    rows, columns = np.concatenate([pairs, pairs[:, ::-1]]).T
    counts = np.bincount(rows, minlength=n)
    free = np.flatnonzero(~boundary(cells, n))
    mean = csr_matrix((1.0 / counts[rows], (rows, columns)), shape=(n, n))[free]
    xy = points.copy()

    def run():
        for _ in range(SWEEPS["scipy"]):
            xy[free] = mean @ xy

    return run, lambda: xy


def start_meshkernel(points, cells):
    """The orthogonalisation of Delft3D FM with its defaults, which guards nothing.

    It slides boundary vertices along the boundary; they are put back where they were.
    """
    import meshkernel

    kernel = meshkernel.MeshKernel()
    x, y = points[:, 0].copy(), points[:, 1].copy()
    pairs = edges(cells).ravel().astype(np.int32)
    kernel.mesh2d_set(meshkernel.Mesh2d(node_x=x, node_y=y, edge_nodes=pairs))
    freely = meshkernel.ProjectToLandBoundaryOption.DO_NOT_PROJECT_TO_LANDBOUNDARY
    parameters = meshkernel.OrthogonalizationParameters()
    nothing = meshkernel.GeometryList(np.empty(0), np.empty(0))

    def run():
        kernel.mesh2d_compute_orthogonalization(freely, parameters, nothing, nothing)

    def result():
        made = kernel.mesh2d_get()
        moved = np.column_stack([made.node_x, made.node_y])
        fixed = boundary(cells, len(points))
        moved[fixed] = points[fixed]
        return moved

    return run, result


class Program(NamedTuple):
    """How a program is started, the package that it comes in, what tables call it; whether it looks
    at the quality of cells, and whether 2K cells take a fraction of a second.
    """

    start: object
    package: str
    title: str
    guarded: bool = True
    quick: bool = True


PROGRAMS = {
    "gmsh-untangle": Program(start_gmsh_untangle, "gmsh", "gmsh UntangleMeshGeometry", quick=False),
    "gmsh-relocate": Program(start_gmsh_relocate, "gmsh", "gmsh Relocate2D, 20 sweeps"),
    "mfem": Program(start_mfem, "mfem", "MFEM TMOP", quick=False),
    "meshkernel": Program(start_meshkernel, "meshkernel", "MeshKernel orthogonalisation"),
    "vtk": Program(start_vtk, "vtk", "VTK Laplacian, 100 sweeps", guarded=False),
    "scipy": Program(start_scipy, "scipy", "scipy Jacobi, 20 sweeps", guarded=False),
}
