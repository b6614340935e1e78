"""Make 2D quadrilateral, triangle and mixed meshes better by moving vertices.

Public names are loaded when first used: importing the package costs next to nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

_HOMES = {
    "Limits": "metrics",
    "Mesh": "mesh",
    "MeshError": "errors",
    "MeshWarning": "errors",
    "Quality": "metrics",
    "SmoothResult": "smoothing",
    "Summary": "metrics",
    "SweepRecord": "smoothing",
    "Validity": "metrics",
    "from_meshio": "adapters.meshio_mesh",
    "limits": "metrics",
    "plot_comparison": "plot",
    "plot_histograms": "plot",
    "plot_mesh": "plot",
    "quality": "metrics",
    "read_mesh": "io",
    "smooth": "smoothing",
    "smooth_angle": "smoothing",
    "smooth_aspect_ratio": "smoothing",
    "smooth_laplacian": "smoothing",
    "smooth_optimize": "smoothing",
    "smooth_quad": "smoothing",
    "smooth_smart_laplacian": "smoothing",
    "smooth_star": "smoothing",
    "to_meshio": "adapters.meshio_mesh",
    "untangle": "smoothing",
    "write_mesh": "io",
}

__all__ = [
    "Limits",
    "Mesh",
    "MeshError",
    "MeshWarning",
    "Quality",
    "SmoothResult",
    "Summary",
    "SweepRecord",
    "Validity",
    "__version__",
    "from_meshio",
    "limits",
    "plot_comparison",
    "plot_histograms",
    "plot_mesh",
    "quality",
    "read_mesh",
    "smooth",
    "smooth_angle",
    "smooth_aspect_ratio",
    "smooth_laplacian",
    "smooth_optimize",
    "smooth_quad",
    "smooth_smart_laplacian",
    "smooth_star",
    "to_meshio",
    "untangle",
    "write_mesh",
]

if TYPE_CHECKING:
    from qsmooth.adapters.meshio_mesh import from_meshio, to_meshio
    from qsmooth.errors import MeshError, MeshWarning
    from qsmooth.io import read_mesh, write_mesh
    from qsmooth.mesh import Mesh
    from qsmooth.metrics import Limits, Quality, Summary, Validity, limits, quality
    from qsmooth.plot import plot_comparison, plot_histograms, plot_mesh
    from qsmooth.smoothing import (
        SmoothResult,
        SweepRecord,
        smooth,
        smooth_angle,
        smooth_aspect_ratio,
        smooth_laplacian,
        smooth_optimize,
        smooth_quad,
        smooth_smart_laplacian,
        smooth_star,
        untangle,
    )


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
