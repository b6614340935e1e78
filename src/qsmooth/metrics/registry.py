"""Every metric: its record here and its kernel are all that there is to add.

Selections, gates, tables, figures, JSON and the command line find it by name in `METRICS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib import import_module
from types import MappingProxyType

import numpy as np

from qsmooth._types import FloatArray
from qsmooth._words import did_you_mean
from qsmooth.metrics.metric import Cells, Metric
from qsmooth.sums import exact_mean

INFINITE = float("inf")
VERDICT = "C. J. Stimpson et al., The Verdict geometric quality library, SAND2007-1751"
ALGEBRAIC = "P. M. Knupp, Algebraic mesh quality metrics, SIAM J. Sci. Comput. 23 (2001)"
SCORES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
RATIOS = (1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, INFINITE)

_metrics: dict[str, Metric] = {}
METRICS: Mapping[str, Metric] = MappingProxyType(_metrics)


def register(metric: Metric) -> None:
    """Add a metric.

    Raises
    ------
    ValueError
        If there is one of that name.
    """
    if metric.name in _metrics:
        raise ValueError(f"there is a metric {metric.name} already")
    _metrics[metric.name] = metric


def find_metric(name: str, option: str = "metric") -> Metric:
    """Look a metric up by its name; `option` is what the message calls it.

    Raises
    ------
    ValueError
        If there is none of that name.
    """
    if name in METRICS:
        return METRICS[name]
    raise ValueError(unknown(name, option))


def unknown(name: str, option: str = "metric") -> str:
    """Say that a name is no metric, which one may be meant, and which there are."""
    return (
        f"{option} must be one of {', '.join(METRICS)}; got {name!r}{did_you_mean(name, METRICS)}"
    )


def parse_metrics(names: str | Sequence[str] | None, option: str = "metrics") -> tuple[str, ...]:
    """Take a choice of metrics apart, as ``"min_angle, taper"`` or a sequence of names.

    ``"all"`` is every metric, None the short table. Each is kept once, where it comes first;
    ``min-angle`` is ``min_angle``. Messages call it `option`.

    Raises
    ------
    ValueError
        If a name is no metric, or there is none.
    """
    if names is None:
        return tuple(name for name, metric in METRICS.items() if metric.short)
    listed = names.split(",") if isinstance(names, str) else names
    wanted = [name.strip().replace("-", "_") for name in listed]
    if wanted == ["all"]:
        return tuple(METRICS)
    if not any(wanted):
        raise ValueError(f"{option} must name at least one of {', '.join(METRICS)}")
    return tuple(dict.fromkeys(find_metric(name, option).name for name in wanted if name))


# ------------------------------------------------------------------------------- how to measure
# Kernels are imported when they are first wanted: with them comes the compiler.


@cache
def _kernel(module: str, kernel: str) -> Callable[..., None]:
    found: Callable[..., None] = getattr(import_module(f"qsmooth.kernels.{module}"), kernel)
    return found


def by_cell(module: str, kernel: str) -> Callable[[Cells], FloatArray]:
    """Measure by a kernel that takes coordinates and cells."""

    def measure(cells: Cells) -> FloatArray:
        out = np.empty(cells.topology.n_cells)
        _kernel(module, kernel)(cells.xy, *cells.topology.cells, out)
        return out

    return measure


def by_figure(name: str) -> Callable[[Cells], FloatArray]:
    """Take one of the figures that are measured together."""
    return lambda cells: cells.figure(name)


def by_inner_edges(kernel: str, centres: str) -> Callable[[Cells], FloatArray]:
    """Measure by a kernel that takes each cell's centre and neighbours."""

    def measure(cells: Cells) -> FloatArray:
        from qsmooth.kernels import finite_volume

        topology = cells.topology
        places, out = np.empty((topology.n_cells, 2)), np.empty(topology.n_cells)
        getattr(finite_volume, centres)(cells.xy, *topology.cells, places)
        getattr(finite_volume, kernel)(
            cells.xy, places, *topology.cells, topology.corner_cells, topology.twins, out
        )
        return out

    return measure


def size_jump(cells: Cells) -> FloatArray:
    """Measure the largest ratio of size between each cell and one it shares an edge with."""
    from qsmooth.kernels import uniformity

    topology = cells.topology
    out = np.empty(topology.n_cells)
    uniformity.size_jump(
        cells.area, topology.cell_offsets, topology.given_twins, topology.corner_cells, out
    )
    return out


def relative_size_squared(cells: Cells) -> FloatArray:
    """Compare each cell's area to the mean of those with as many corners."""
    from qsmooth.kernels import verdict_metrics

    areas = np.abs(cells.area)
    mean = {}
    for n in (3, 4):
        counted = (cells.topology.cell_sizes == n) & np.isfinite(areas)
        mean[n] = exact_mean(areas[counted]) if counted.any() else 0.0
    out = np.empty(cells.topology.n_cells)
    verdict_metrics.relative_size_squared(
        cells.area, cells.topology.cell_offsets, mean[3], mean[4], out
    )
    return out


# ------------------------------------------------------------------------------- the short table

register(
    Metric(
        name="min_angle",
        measure=by_figure("min_angle"),
        words="smallest angle",
        definition="smallest interior angle of a cell, on the left of its boundary",
        evident=True,
        higher_is_better=True,
        ideal=90.0,
        triangle_ideal=60.0,
        span=(0.0, 360.0),
        unit="°",
        bins=tuple(range(0, 91, 10)),
        worst_colour=0.0,
        short=True,
        number=".2f",
        blind=True,
    )
)
register(
    Metric(
        name="max_angle",
        measure=by_figure("max_angle"),
        words="largest angle",
        definition="largest interior angle of a cell, over 180° at a concave corner",
        evident=True,
        higher_is_better=False,
        ideal=90.0,
        triangle_ideal=60.0,
        span=(0.0, 360.0),
        unit="°",
        bins=(*range(60, 181, 10), INFINITE),
        worst_colour=180.0,
        short=True,
        number=".2f",
        blind=True,
    )
)
register(
    Metric(
        name="aspect_ratio",
        measure=by_figure("aspect_ratio"),
        words="aspect ratio",
        definition="longest over shortest edge of a cell",
        higher_is_better=False,
        span=(1.0, INFINITE),
        bins=(*range(0, 21, 2), INFINITE),
        worst_colour=10.0,
        mean="finite",
        short=True,
        number=".2f",
        blind=True,
    )
)
register(
    Metric(
        name="scaled_jacobian",
        measure=by_figure("scaled_jacobian"),
        words="scaled Jacobian",
        definition="sine of a cell's worst corner (in triangles over that of 60°)",
        source=ALGEBRAIC,
        higher_is_better=True,
        span=(-2.0 / 3.0**0.5, 1.0),
        worst_colour=0.0,
        short=True,
    )
)
register(
    Metric(
        name="shape",
        measure=by_figure("shape"),
        words="shape",
        definition="mean ratio of a cell's worst corner",
        source="P. M. Knupp, Finite Elements in Analysis and Design 39 (2003)",
        higher_is_better=True,
        span=(0.0, 1.0),
        worst_colour=0.0,
        short=True,
    )
)
register(
    Metric(
        name="size_jump",
        measure=size_jump,
        words="size ratio",
        definition=(
            "largest ratio of a cell's area to that of a cell next to it (each over that of the "
            "ideal cell)"
        ),
        higher_is_better=False,
        span=(1.0, INFINITE),
        inner=True,
        worst_colour=4.0,
        mean="geometric",
        short=True,
        number=".2f",
    )
)

# ------------------------------------------------------------------------------- VTK's verdict

register(
    Metric(
        name="edge_ratio",
        measure=by_figure("aspect_ratio"),
        words="edge ratio",
        definition="longest over shortest edge of a cell, verdict's name of the aspect ratio",
        source=VERDICT,
        higher_is_better=False,
        span=(1.0, INFINITE),
        bins=RATIOS,
        worst_colour=10.0,
        mean="finite",
        number=".2f",
        blind=True,
    )
)
register(
    Metric(
        name="verdict_aspect_ratio",
        measure=by_cell("verdict_metrics", "verdict_aspect_ratio"),
        words="aspect ratio of verdict",
        many="aspect ratios of verdict",
        definition="longest edge of a cell by its perimeter, over its area and the ideal cell's",
        source=VERDICT,
        higher_is_better=False,
        span=(1.0, INFINITE),
        bins=RATIOS,
        worst_colour=10.0,
        mean="finite",
        number=".2f",
    )
)
register(
    Metric(
        name="condition",
        measure=by_cell("verdict_metrics", "condition"),
        words="condition number",
        definition="condition number of a cell's worst corner, over that of the ideal corner",
        source=f"{VERDICT}; {ALGEBRAIC}",
        higher_is_better=False,
        span=(1.0, INFINITE),
        bins=RATIOS,
        worst_colour=10.0,
        mean="finite",
        number=".3f",
    )
)
register(
    Metric(
        name="skew",
        measure=by_cell("verdict_metrics", "skew"),
        words="skew",
        many="skews",
        definition="cosine between the two lines that join the middles of a quad's opposite edges",
        source=f"{VERDICT}; J. Robinson, Engineering Computations 4 (1987)",
        higher_is_better=False,
        ideal=0.0,
        span=(0.0, 1.0),
        corners=(4,),
        bins=SCORES,
        worst_colour=1.0,
    )
)
register(
    Metric(
        name="taper",
        measure=by_cell("verdict_metrics", "taper"),
        words="taper",
        definition=(
            "difference of a quad's opposite edges over the shorter of its axes, each the sum of "
            "two opposite edges"
        ),
        source=f"{VERDICT}; J. Robinson, Engineering Computations 4 (1987)",
        higher_is_better=False,
        ideal=0.0,
        span=(0.0, INFINITE),
        corners=(4,),
        bins=(*SCORES, INFINITE),
        worst_colour=1.0,
        mean="finite",
    )
)
register(
    Metric(
        name="stretch",
        measure=by_cell("verdict_metrics", "stretch"),
        words="stretch",
        many="stretches",
        definition="shortest edge of a quad over its longer diagonal, and over that of a square",
        source=VERDICT,
        higher_is_better=True,
        span=(0.0, 1.0),
        corners=(4,),
        bins=SCORES,
        worst_colour=0.0,
    )
)
register(
    Metric(
        name="distortion",
        measure=by_cell("verdict_metrics", "distortion"),
        words="distortion",
        definition="least Jacobian in a cell over its mean; any valid triangle has 1",
        source=VERDICT,
        higher_is_better=True,
        span=(-INFINITE, 1.0),
        bins=SCORES,
        worst_colour=0.0,
        mean="finite",
    )
)
register(
    Metric(
        name="shear",
        measure=by_cell("verdict_metrics", "shear"),
        words="shear",
        definition="sine of a quad's worst corner, no less than 0",
        source=f"{VERDICT}; P. M. Knupp, Finite Elements in Analysis and Design 39 (2003)",
        higher_is_better=True,
        span=(0.0, 1.0),
        corners=(4,),
        bins=SCORES,
        worst_colour=0.0,
    )
)
register(
    Metric(
        name="oddy",
        measure=by_cell("verdict_metrics", "oddy"),
        words="Oddy distortion",
        definition="how far the metric tensor of a quad's worst corner is from that of a square",
        source=f"{VERDICT}; A. Oddy et al., Transactions of the CSME 12 (1988)",
        higher_is_better=False,
        ideal=0.0,
        span=(0.0, INFINITE),
        corners=(4,),
        bins=(0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 100.0, INFINITE),
        worst_colour=10.0,
        mean="finite",
    )
)
register(
    Metric(
        name="relative_size_squared",
        measure=relative_size_squared,
        words="relative size squared",
        many="relative sizes squared",
        definition="square of a cell's area over the mean area of its kind, or of the inverse",
        source=VERDICT,
        higher_is_better=True,
        span=(0.0, 1.0),
        bins=SCORES,
        worst_colour=0.0,
    )
)

# ------------------------------------------------------------------------------- what solvers ask

register(
    Metric(
        name="min_edge",
        measure=by_cell("cell_metrics", "min_edge"),
        words="shortest edge",
        definition="length of a cell's shortest edge, which bounds the time step",
        evident=True,
        higher_is_better=True,
        ideal=None,
        span=(0.0, INFINITE),
        unit="length",
        worst_colour=None,
        number=".4g",
        blind=True,
    )
)
register(
    Metric(
        name="orthogonality",
        measure=by_inner_edges("orthogonality", "circumcentres"),
        words="orthogonality",
        many="orthogonalities",
        definition="cosine between an inner edge and the line through its cells' circumcentres",
        source="Deltares, MeshKernel and D-Flow FM",
        higher_is_better=False,
        ideal=0.0,
        span=(0.0, 1.0),
        inner=True,
        bins=(0.0, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0),
        worst_colour=0.5,
    )
)
register(
    Metric(
        name="non_orthogonality",
        measure=by_inner_edges("non_orthogonality", "centroids"),
        words="non-orthogonality",
        many="non-orthogonalities",
        definition="angle between the normal of an inner edge and the line of its cells' centroids",
        source="OpenFOAM, checkMesh",
        higher_is_better=False,
        ideal=0.0,
        span=(0.0, 180.0),
        unit="°",
        inner=True,
        bins=(*range(0, 91, 10), 180),
        worst_colour=90.0,
        number=".2f",
    )
)
register(
    Metric(
        name="skewness",
        measure=by_inner_edges("skewness", "centroids"),
        words="skewness",
        many="skewnesses",
        definition=(
            "how far from an inner edge's middle the line of its cells' centroids crosses it, over "
            "half the edge"
        ),
        source="OpenFOAM, checkMesh",
        higher_is_better=False,
        ideal=0.0,
        span=(0.0, INFINITE),
        inner=True,
        bins=(0.0, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 4.0, INFINITE),
        worst_colour=2.0,
        mean="finite",
    )
)
