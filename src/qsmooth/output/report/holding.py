"""What holds a cell: the limit or the constraint that keeps it from getting better, in words."""

from __future__ import annotations

import math
from functools import cached_property

import numpy as np

from qsmooth._types import FloatArray, IndexArray
from qsmooth._words import in_a_row, plural
from qsmooth.metrics import METRICS, Validity
from qsmooth.metrics.bounds import vertex_bounds
from qsmooth.metrics.impossible import Impossible, impossible
from qsmooth.outcome import Stop
from qsmooth.output.report.states import State
from qsmooth.wording import kept_back

# An angle is at its limit within so many degrees: what sweeps leave before they stop.
NEAR = 0.05
# A vertex has gone as far as it may from this share of its reach on.
FAR = 0.999
ANGLES = {"min_angle": 0, "max_angle": 1}


class Holding:
    """What holds the cells of a state; each sentence says no more than is known."""

    def __init__(self, state: State, start: State) -> None:
        self.state, self.start = state, start
        self.topology, self.xy = state.mesh.topology, state.mesh.xy
        self.movable = state.movable

    def why(self, cell: int, metric: str) -> tuple[str, int | None]:
        """Say what holds a cell's figure; and the vertex at which, None where there is none."""
        corners = self.corners_of(cell)
        free = self.movable[corners]
        said = self._proven_invalid(cell)
        if not free.any():
            words = self._kept_words(corners)
            return "; ".join([*said, f"all its vertices stay{words}"]), None
        at: int | None = None
        if not said and metric in ANGLES:
            text, at = self._by_angle(cell, corners, ANGLES[metric])
            said += [text] if text else []
        elif not said and metric in ("aspect_ratio", "edge_ratio", "min_edge"):
            said += self._by_edges(corners, metric)
        said += self._by_reach(corners)
        said += self._by_outcome(cell)
        if not said:
            moves = f"{int(free.sum())} of its {len(corners)} vertices may move"
            said.append(f"nothing proven: {moves}{self._cut_short()}")
        return "; ".join(said), at

    def corners_of(self, cell: int) -> IndexArray:
        offsets, vertices = self.topology.cells
        corners: IndexArray = vertices[offsets[cell] : offsets[cell + 1]]
        return corners

    def _kept_words(self, corners: IndexArray) -> str:
        words = [text for text, marks in self.state.kept if marks[corners].any()]
        return f" ({in_a_row(words)})" if words else ""

    # --------------------------------------------------------------------------- invalid cells

    def _proven_invalid(self, cell: int) -> list[str]:
        if self.state.quality.validity[cell] == Validity.VALID:
            return []
        if self._impossible.by_fixed[cell]:
            return ["no placement makes it valid, as what stays keeps a corner from being convex"]
        if self._impossible.by_doublet[cell]:
            return ["no placement makes it valid, nor the other cell of a vertex with only two"]
        kind = Validity(int(self.state.quality.validity[cell])).name.lower()
        return [f"it is {kind}; that no placement mends it is not proven"]

    @cached_property
    def _impossible(self) -> Impossible:
        return impossible(self.topology, self.xy, self.movable)

    # --------------------------------------------------------------------------- angles

    def _by_angle(self, cell: int, corners: IndexArray, which: int) -> tuple[str, int | None]:
        angles = [self._angle(corners, k) for k in range(len(corners))]
        k = int(np.argmin(angles) if which == 0 else np.argmax(angles))
        v, n = int(corners[k]), len(corners)
        around = corners[[k - 1, k, (k + 1) % n]]
        if not self.movable[around].any():
            return f"its corner at vertex {v} lies between two edges that stay", v
        bound = float(self._bounds[which][v])
        trivial = 60.0 if n == 3 else 90.0
        if not math.isfinite(bound) or (bound >= trivial if which == 0 else bound <= trivial):
            return "", None
        short = bound - angles[k] if which == 0 else angles[k] - bound
        cells = int(np.diff(self.topology.star_offsets[[v, v + 1]])[0])
        end = "at most" if which == 0 else "at least"
        text = f"one of the {cells} cells at vertex {v} has {bound:.2f}° {end} in any placement"
        if cells == 1:
            text = f"its corner at vertex {v} has {bound:.2f}° {end} in any placement"
        if short <= NEAR:
            return f"{text}: this limit is reached", v
        return f"{text}, {short:.2f}° from here; nothing more is proven", v

    def _angle(self, corners: IndexArray, k: int) -> float:
        """Angle of a cell at its k-th corner, on the left of its boundary, degrees."""
        here = self.xy[corners[k]]
        on = self.xy[corners[(k + 1) % len(corners)]] - here
        back = self.xy[corners[k - 1]] - here
        sine, cosine = on[0] * back[1] - on[1] * back[0], on[0] * back[0] + on[1] * back[1]
        return math.degrees(math.atan2(float(sine), float(cosine))) % 360.0

    @cached_property
    def _bounds(self) -> tuple[FloatArray, FloatArray]:
        """Bounds of the smallest and of the largest angle at each vertex, (n_vertices,)."""
        swings = None
        if self.state.freedom is not None:
            from qsmooth.numbering import Inside
            from qsmooth.sliding import slider_of

            start = self.start.mesh
            slider = slider_of(self.state.freedom, start, Inside(start, kept=True))
            swings = None if slider is None else slider.swings(self.xy)
        return vertex_bounds(self.topology, self.xy, self.movable, swings)

    # --------------------------------------------------------------------------- all others

    def _by_edges(self, corners: IndexArray, metric: str) -> list[str]:
        ends = np.roll(corners, -1)
        lengths = np.linalg.norm(self.xy[ends] - self.xy[corners], axis=1)
        stays = ~(self.movable[corners] | self.movable[ends])
        shortest, longest = int(lengths.argmin()), int(lengths.argmax())
        said = []
        if stays[shortest]:
            said.append(f"its shortest edge, {corners[shortest]}-{ends[shortest]}, stays")
        if stays[longest] and metric != "min_edge":
            said.append(f"its longest edge, {corners[longest]}-{ends[longest]}, stays")
        return said

    def _by_reach(self, corners: IndexArray) -> list[str]:
        freedom = self.state.freedom
        if freedom is None or self.state.result is None:
            return []
        said, own = [], corners[self.movable[corners]]
        if freedom.reach is not None:
            moves = np.linalg.norm(self.xy[own] - freedom.origin[own], axis=1)
            far = own[moves >= FAR * freedom.reach[own]]
            if far.size:
                many = plural(far.size, "of its vertices has", "of its vertices have")
                said.append(f"{many} moved as far as allowed, the first is vertex {far[0]}")
        if freedom.directions is not None:
            bound = own[np.isfinite(freedom.directions[own, 0])]
            if bound.size:
                said.append(f"vertex {bound[0]} may move along its own direction only")
        return said

    def _by_outcome(self, cell: int) -> list[str]:
        result = self.state.result
        if result is None:
            return []
        return [kept_back(held) for held in result.outcome.held if held.cell == cell]

    def _cut_short(self) -> str:
        result = self.state.result
        cut = Stop.MAX_SWEEPS, Stop.TIME_LIMIT, Stop.CALLBACK
        if result is None or result.outcome.stop not in cut:
            return ""
        return ", and the run was cut short"


def worst_cells(
    state: State, holding: Holding, metrics: tuple[str, ...], shown: tuple[str, ...], k: int
) -> list[dict[str, object]]:
    """List the `k` worst cells by each of some metrics, with their figures and what holds them."""
    listed: list[dict[str, object]] = []
    for name in metrics:
        for cell in METRICS[name].worst_cells(state.quality[name], k).tolist():
            corners = holding.corners_of(cell)
            words, vertex = holding.why(cell, name)
            values = {each: float(state.quality[each][cell]) for each in (*shown, name)}
            listed.append(
                {
                    "cell": cell,
                    "place": state.mesh.xy[corners].mean(axis=0),
                    "values": values,
                    "metric": name,
                    "why": words,
                    "vertex": vertex,
                }
            )
    return listed
