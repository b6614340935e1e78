"""Compiling ahead: small meshes are smoothed, so that large ones need not wait."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from qsmooth import examples
from qsmooth.kernels.compiling import compiled_kernels
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.metrics import limits, quality
from qsmooth.registry import all_methods, method_class, methods
from qsmooth.remapping import transfer
from qsmooth.session import Smoother

# How far the boundary has turned at each step of a session, degrees: it stays, goes on and on, so
# that what is inside follows, and jumps, so that cells fold over.
TURNS = (0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 60.0, 60.0)


def warmup(
    names: str | Iterable[str] | None = None,
    *,
    session: bool = False,
    slide: bool = False,
    interpolate: bool = False,
) -> int:
    """Compile what methods need ahead of their first use; it is kept on disk.

    What is compiled already costs a second or so. What only an option asks for is left to its
    first use, unless it is named here: targets other than the default, metrics beyond the short
    list, `transfer` for values of cells, and steps in double precision, which few meshes need.

    Parameters
    ----------
    names
        Names of methods, or one name; all by default.
    session
        Also what the steps of a `Smoother` with these methods need.
    slide
        Also what ``boundary="slide"`` and ``interfaces="slide"`` need with these methods.
    interpolate
        Also what interpolates at new places: z of a mesh with ``surface="flat"``, point data, and
        values that `transfer` takes over.

    Returns
    -------
    int
        How many kernels had to be compiled.

    Raises
    ------
    ValueError
        If there is no such method.
    """
    before = compiled_kernels()
    names = methods() if names is None else [names] if isinstance(names, str) else names
    chosen = [method_class("optimize" if name == "auto" else name) for name in names]
    if any(method.name == "optimize" for method in chosen):
        chosen.append(all_methods()["untangle"])
    for method in chosen:
        for mesh in _meshes():
            _run(method, mesh)
            if slide:
                _run(method, mesh, boundary="slide")
            if session:
                _step(method, mesh)
    if interpolate:
        _interpolate()
    return compiled_kernels() - before


def _run(method: type[Method], mesh: Mesh, **options: Any) -> None:
    """Smooth a mesh, and measure it as the shell does."""
    ready = method(threads=1, **options)
    if ready.why_not(mesh):
        return
    result = ready.run(mesh)
    quality(result.mesh).summary()
    limits(result.mesh)


def _step(method: type[Method], mesh: Mesh) -> None:
    """Let a mesh follow its boundary through a few steps."""
    ready = method(threads=1)
    if ready.why_not(mesh):
        return
    smoother, points = Smoother(mesh, ready), mesh.points.copy()
    given = points[mesh.is_boundary]
    for turn in np.radians(TURNS):
        cosine, sine = np.cos(turn), np.sin(turn)
        points[mesh.is_boundary] = given @ np.array([[cosine, sine], [-sine, cosine]])
        smoother.step(points)


def _interpolate() -> None:
    """Take values over to other places; where the mesh is folded, all of its cells are asked."""
    folded = examples.tangled(10, 10, seed=1)
    transfer(folded, examples.structured(10, 10), folded.points[:, 0])


def _meshes() -> Iterator[Mesh]:
    """Small meshes that lead through all stages: mixed, tangled, with layers, slow to settle."""
    yield examples.jittered(8, 8, kind="mixed", seed=1)
    folded = examples.tangled(10, 10, seed=1)
    # Clockwise, and with areas of both signs, so that cells have to be oriented.
    yield Mesh(folded.points, [cells[:, ::-1] for cells in folded.cells])
    yield examples.boundary_layer(12, 8)
    # It has a last colour of few vertices, which it can do without, and steps that are put back.
    yield examples.bump(18, height=0.8, width=0.1)
