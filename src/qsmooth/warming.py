"""Compiling ahead: small meshes are smoothed, so that large ones need not wait."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from qsmooth import examples
from qsmooth.kernels.compiling import compiled_kernels
from qsmooth.metrics import limits, quality
from qsmooth.registry import all_methods, method_class, methods

if TYPE_CHECKING:
    from qsmooth.mesh import Mesh
    from qsmooth.methods.base import Method


def warmup(names: str | Iterable[str] | None = None) -> int:
    """Compile what methods need ahead of their first use; it is kept on disk.

    What is compiled already costs a second or so. What only an option asks for is left to its
    first use: targets other than the default, and metrics beyond the short list. So is what finds
    depths anew with `surface="flat"`, and steps in double precision, which few meshes need.

    Parameters
    ----------
    names
        Names of methods, or one name; all by default.

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
    return compiled_kernels() - before


def _run(method: type[Method], mesh: Mesh) -> None:
    """Smooth a mesh, and measure it as the shell does."""
    ready = method(threads=1)
    if ready.why_not(mesh):
        return
    result = ready.run(mesh)
    quality(result.mesh).summary()
    limits(result.mesh)


def _meshes() -> Iterator[Mesh]:
    """Small meshes that lead through all stages: mixed, tangled, with layers, slow to settle."""
    yield examples.jittered(8, 8, kind="mixed", seed=1)
    yield examples.tangled(10, 10, seed=1)
    yield examples.boundary_layer(12, 8)
    # It has a last colour of few vertices, which it can do without, and steps that are put back.
    yield examples.bump(18, height=0.8, width=0.1)
