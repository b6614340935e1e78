"""Why anyone smooths: Poisson's equation on a bad mesh, and on the same mesh smoothed.

    python examples/poisson.py [FOLDER]

The solution is known, so that errors can be measured: u = sin(2 x) cos(3 y) over the lake. Finite
elements are those of scikit-fem (pip install 'qsmooth[interop]'). Printed are the condition number
of the matrix, iterations of conjugate gradients, and errors of values and slopes; poisson.png shows
where the errors are.
"""

import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from scipy.sparse.linalg import cg, eigsh
from skfem import Basis, BilinearForm, ElementQuad1, Functional, LinearForm, MeshQuad, condense

from qsmooth import Mesh, smooth
from qsmooth.examples import lake

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp(prefix="qsmooth-"))


def u(x):
    """Solution; its Laplacian is -13 u."""
    return np.sin(2 * x[0]) * np.cos(3 * x[1])


def slope(x):
    """Its derivatives along x and y."""
    along_x = 2 * np.cos(2 * x[0]) * np.cos(3 * x[1])
    return np.stack([along_x, -3 * np.sin(2 * x[0]) * np.sin(3 * x[1])])


@BilinearForm
def stiffness(v, w, _):
    """Matrix of the Laplacian."""
    return v.grad[0] * w.grad[0] + v.grad[1] * w.grad[1]


@LinearForm
def load(w, at):
    """Right side."""
    return 13.0 * u(at.x) * w


@Functional
def squared_errors(at):
    """Square of the error of values."""
    return (at.found - u(at.x)) ** 2


@Functional
def squared_slope_errors(at):
    """Square of the error of slopes."""
    return ((at.found.grad - slope(at.x)) ** 2).sum(axis=0)


def solve(mesh: Mesh):
    """Errors at the vertices, and what is printed."""
    elements = MeshQuad(mesh.xy.T.copy(), mesh.cell_vertices.reshape(-1, 4).T.copy())
    basis = Basis(elements, ElementQuad1(), intorder=6)
    matrix, right = stiffness.assemble(basis), load.assemble(basis)
    # What is known on the boundary goes to the right side.
    matrix, right, found, inner = condense(matrix, right, x=u(basis.doflocs), D=basis.get_dofs())
    steps = []
    found[inner], failed = cg(matrix, right, rtol=1e-10, callback=steps.append)
    assert not failed
    largest = eigsh(matrix, k=1, return_eigenvectors=False)[0]
    smallest = eigsh(matrix, k=1, sigma=0.0, return_eigenvectors=False)[0]
    known = {"found": basis.interpolate(found)}
    figures = {
        "condition number": largest / smallest,
        "iterations": len(steps),
        "error of values": np.sqrt(squared_errors.assemble(basis, **known)),
        "error of slopes": np.sqrt(squared_slope_errors.assemble(basis, **known)),
    }
    return np.abs(found - u(basis.doflocs)), figures


mesh = lake(2000)
size = np.ptp(mesh.xy, axis=0).max()
mesh = mesh.with_points((mesh.xy - mesh.xy.min(axis=0)) / size * 3.0)  # a few waves across
result = smooth(mesh)
runs = {"as it came": mesh, "smoothed": result.mesh}

matplotlib.use("Agg")
figure = Figure(figsize=(10, 3), layout="constrained")
panels = figure.subplots(1, 2)
print(f"{mesh.n_cells} quads, {result.reason}")
for (name, run), panel in zip(runs.items(), panels, strict=True):
    errors, figures = solve(run)
    print(f"{name}: " + ", ".join(f"{what} {value:.3g}" for what, value in figures.items()))
    quads = PolyCollection(run.xy[run.cells[0]], array=errors[run.cells[0]].mean(axis=1))
    quads.set_clim(0.0, 0.005)
    panel.add_collection(quads)
    panel.autoscale()
    panel.set(title=name, aspect="equal")
figure.colorbar(quads, ax=panels, label="error")
figure.savefig(folder / "poisson.png", dpi=100)
print(folder / "poisson.png")
