"""What became of a mesh, in sentences: sizes, what was promised and kept, what was traded."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from qsmooth._types import FloatArray
from qsmooth._words import plural
from qsmooth.metrics import METRICS
from qsmooth.output.report.states import State
from qsmooth.wording import given_up, towards

# Percentiles of the changes of areas.
SHARES = (1.0, 50.0, 99.0)
# What optimize holds in every region, and so in the mesh.
HELD = ("min_angle", "max_angle", "scaled_jacobian")


def area_change(before: State, after: State) -> FloatArray:
    """Areas over what they were, (n_cells,); NaN of cells that had none, or had it inverted."""
    was, now = before.quality.area, after.quality.area
    change = np.full(was.size, np.nan)
    np.divide(now, was, out=change, where=was > 0.0)
    return change


def sizes(before: State, after: State) -> list[str]:
    """Say how far vertices went, and what became of areas and edges."""
    moves = np.linalg.norm(after.mesh.xy - before.mesh.xy, axis=1)
    far = int(moves.argmax())
    if moves[far] == 0.0:
        return ["no vertex moved"]
    n_moved = int(np.count_nonzero(moves))
    of = plural(len(moves), "vertex", "vertices")
    said = [f"{n_moved} of {of} moved, by {moves[far]:.3g} at most (vertex {far})"]
    change = area_change(before, after)
    known = change[np.isfinite(change)]
    if known.size:
        low, middle, high = np.percentile(known, SHARES)
        said.append(
            f"areas are {low:.3g} to {high:.3g} times what they were (1st to 99th percentile), "
            f"{middle:.3g} times in the median"
        )
        grown, shrunk = int(np.nanargmax(change)), int(np.nanargmin(change))
        said.append(
            f"cell {grown} grew most, to {change[grown]:.3g} times its area; cell {shrunk} shrank "
            f"most, to {change[shrunk]:.3g} times"
        )
    edges = [state.quality["min_edge"] for state in (before, after)]
    said.append(f"the shortest edge was {edges[0].min():.4g}, and is {edges[1].min():.4g}")
    return said


def promised(before: State, after: State) -> list[str]:
    """Say what the method promises, and what is found of it by measuring."""
    if after.result is None:
        return []
    moved = (after.mesh.xy != before.mesh.xy).any(axis=1)
    strayed = int(np.count_nonzero(moved & ~after.movable))
    stay = int(np.count_nonzero(~after.movable))
    said = [
        "vertices that may not move stay: "
        f"{strayed or 'none'} of {plural(stay, 'vertex', 'vertices')} moved"
    ]
    outcome = after.result.outcome
    broken = (before.quality.validity == 0) & (after.quality.validity != 0)
    found = f"{int(broken.sum()) or 'none'} of {plural(before.mesh.n_cells, 'cell')} became invalid"
    word = "valid cells stay valid" if outcome.guarded else "nothing is promised of validity"
    if outcome.cut is not None:
        word = "the triangles that quads were cut into stay valid"
    said.append(f"{word}: {found}")
    if outcome.untangles and before.quality.n_invalid == 0:
        said += [f"{METRICS[name].words} gets no worse: {_worst(before, after, name)}"
                 for name in HELD]  # fmt: skip
    return said


def _worst(before: State, after: State, name: str) -> str:
    metric = METRICS[name]
    was, now = (metric.worst_of(state.quality[name]) for state in (before, after))
    return f"{metric.text(was)} before, {metric.text(now)} after"


def traded(after: State, spell: Callable[[str], str]) -> list[str]:
    """Say what got worse for what, and what is held."""
    if after.result is None:
        return []
    outcome = after.result.outcome
    return [*towards(outcome.target), *given_up(outcome, spell)]


def limits(before: State, after: State) -> list[str]:
    """Bounds of the angles, as the shell tells them."""
    from qsmooth import sliding
    from qsmooth.metrics import Limits, angle_limits

    result, freedom = after.result, after.freedom
    if result is not None and isinstance(result.outcome.limits, Limits):
        found = result.outcome.limits
    elif freedom is not None:
        found = sliding.limits_of(freedom, before.mesh, after.mesh)
    else:
        mesh = after.mesh
        found = angle_limits(mesh.topology, mesh.xy, after.movable, after.quality, after.kept)
    return str(found).splitlines()
