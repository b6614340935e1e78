"""Vertices that slide in the steps of a session: along the outline as the host last gave it."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from qsmooth._types import BoolArray, FloatArray, IndexArray
from qsmooth.constraints import Freedom, on_map
from qsmooth.curves import line_of
from qsmooth.kernels.rails import Rails
from qsmooth.mesh import Mesh
from qsmooth.methods.base import Method
from qsmooth.numbering import Inside
from qsmooth.outline import Chains
from qsmooth.sliding import Slider

# Nothing is a corner at this angle.
HALF_TURN = 180.0


class Layout(NamedTuple):
    """What can slide in some step of a session, whatever is a corner then.

    Attributes
    ----------
    freedom
        What may move, in the caller's order; its chains end only where more than the angle says so.
    own : (n_chains,)
        Chains that are their own lines; the others lie on a curve, and end at its corners, too.
    """

    freedom: Freedom
    own: BoolArray


def layout_of(method: Method, mesh: Mesh) -> Layout:
    """Find what can slide."""
    if "slide" not in (method.boundary, method.interfaces):
        return Layout(method.freedom(mesh), np.zeros(0, np.bool_))
    everywhere = replace(method, corner_angle=HALF_TURN, curve=None)
    on_curve = None if method.curve is None else _on_curve(method.freedom(mesh).chains)
    if on_curve is None:
        freedom = everywhere.freedom(mesh)
        return Layout(freedom, _own(freedom.chains, True))
    taken = np.zeros(mesh.n_vertices, np.bool_)
    taken[on_curve.vertices] = True
    fixed = taken if method.fixed is None else taken | method.fixed
    freedom = replace(everywhere, fixed=fixed).freedom(mesh)
    own = np.r_[_own(freedom.chains, True), _own(on_curve, False)]
    chains = on_curve if freedom.chains is None else _joined(freedom.chains, on_curve)
    movable = freedom.movable | on_curve.sliding(mesh.n_vertices)
    return Layout(replace(freedom, movable=movable, chains=chains), own)


def _own(chains: Chains | None, own: bool) -> BoolArray:
    return np.full(0 if chains is None else chains.on_boundary.size, own)


def _on_curve(chains: Chains | None) -> Chains | None:
    """Give those of the chains that are not their own lines; None where all are."""
    if chains is None:
        return None
    chosen = chains.follows
    if not chosen.any():
        return None
    entries = np.repeat(chosen, np.diff(chains.offsets))
    return replace(
        chains,
        vertices=chains.vertices[entries],
        offsets=np.cumsum([0, *np.diff(chains.offsets)[chosen]]),
        on_boundary=chains.on_boundary[chosen],
        segments=chains.segments[entries],
        fractions=chains.fractions[entries],
        off=chains.off[entries],
        follows=chains.follows[chosen],
    )


def _joined(one: Chains, other: Chains) -> Chains:
    """Put chains behind others."""
    return Chains(
        vertices=np.r_[one.vertices, other.vertices],
        offsets=np.r_[one.offsets, one.vertices.size + other.offsets[1:]],
        on_boundary=np.r_[one.on_boundary, other.on_boundary],
        nodes=np.concatenate([one.nodes, other.nodes]),
        segments=np.r_[one.segments, len(one.nodes) + other.segments],
        fractions=np.r_[one.fractions, other.fractions],
        off=np.r_[one.off, other.off],
        follows=np.r_[one.follows, other.follows],
        project=other.project,
    )


class StepSlider(Slider):
    """The vertices that slide, and the lines that they slide along in each step.

    The line of a chain is laid through its vertices anew when the host has moved one of them. As
    long as it has not it stays: else a bent outline would be cut short a little in every step. On a
    curve the line stays as long as the ends of the chain do.

    Parameters
    ----------
    mesh, inside
        As for `Slider`.
    layout
        What can slide.
    method
        Says what is a corner, and which curve takes the place of the outline.
    rails
        Where vertices may be besides, in the order inside.
    """

    def __init__(
        self, mesh: Mesh, inside: Inside, layout: Layout, method: Method, rails: Rails
    ) -> None:
        chains = layout.freedom.chains
        assert chains is not None
        super().__init__(mesh, inside, chains, layout.freedom.tolerance, rails)
        self._own, self._corner_angle = layout.own, method.corner_angle
        self._curve = on_map(method.curve, mesh.projection)
        self._curved = np.flatnonzero(~layout.own)
        self._fresh = np.empty(layout.own.size, np.bool_)
        self._end_places = inside.at_vertices(mesh.xy)[self._end_vertices]

    @cached_property
    def _end_vertices(self) -> IndexArray:
        """First and last vertex of each chain on a curve, (k, 2)."""
        found: IndexArray = self._outline.vertices[self.chains.ends[self._curved]]
        return found

    @cached_property
    def _chain_of(self) -> IndexArray:
        """Chain of each vertex that slides, in the order of the blocks."""
        offsets = self.chains.offsets
        return np.searchsorted(offsets, self._outline.entries, side="right") - 1

    def start(self, xy: FloatArray, changed: BoolArray) -> None:
        """Let lines be where the host has put their vertices, (n_vertices,) `changed`."""
        from qsmooth.kernels.outline import fit_boxes, locate
        from qsmooth.kernels.slide_starts import start_outline

        if self._curved.size:
            self._follow_ends(xy)
        start_outline(
            xy, changed, self._outline, self.chains.offsets, self._own, self._chain_of,
            self._corner_angle, self._fresh,
        )  # fmt: skip
        if self._curved.size:
            locate(xy, self._outline, self.chains.ends[self._curved[self._fresh[self._curved]]])
        fit_boxes(xy, self._sides)

    def go_on(self, xy: FloatArray) -> None:
        """Find out where the vertices are on the same lines, as others have moved them."""
        from qsmooth.kernels.outline import fit_boxes, locate

        locate(xy, self._outline, self.chains.ends)
        fit_boxes(xy, self._sides)

    def state(self) -> tuple[Any, ...]:
        """What a copy needs to go on from here; it does not depend on the order inside."""
        outline = self._outline
        places = outline.nodes, outline.segments, outline.fractions, outline.off, outline.free
        return tuple(of.copy() for of in (*places, self._own, self._end_places))

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go on from there."""
        nodes, segments, fractions, off, free, self._own, self._end_places = state
        self.__dict__["_outline"] = self._outline._replace(
            nodes=nodes, segments=segments, fractions=fractions, off=off, free=free
        )

    def chains_now(self) -> Chains:
        """Give what may slide now, of the caller's vertices: chains from corner to corner."""
        outline, offsets = self._outline, self.chains.offsets
        stays = np.ones(outline.vertices.size, np.bool_)
        stays[outline.entries[outline.free]] = False
        pieces, of = [], []
        for chain in range(self._own.size):
            ends = offsets[chain] + np.flatnonzero(stays[offsets[chain] : offsets[chain + 1]])
            longer = np.flatnonzero(np.diff(ends) > 1)
            pieces += [np.arange(ends[k], ends[k + 1] + 1) for k in longer]
            of += [chain] * longer.size
        entries = np.concatenate([np.empty(0, np.int64), *pieces])
        return Chains(
            vertices=self.chains.vertices[entries],
            offsets=np.cumsum([0, *(piece.size for piece in pieces)]),
            on_boundary=self.chains.on_boundary[np.array(of, np.int64)],
            nodes=outline.nodes.copy(),
            segments=outline.segments[entries],
            fractions=outline.fractions[entries],
            off=outline.off[entries],
            follows=~self._own[np.array(of, np.int64)],
        )

    def _follow_ends(self, xy: FloatArray) -> None:
        """Take other stretches of the curve where ends of chains have moved."""
        now = xy[self._end_vertices]
        if np.array_equal(now, self._end_places):
            return
        self._end_places = now
        outline, lines = self._outline, []
        for chain, (first, last) in enumerate(self.chains.ends.tolist()):
            segments = outline.segments[first : last + 1]
            nodes = outline.nodes[segments[0] : segments[-1] + 2]
            start = segments[0]
            if chain in self._curved:
                places = xy[outline.vertices[first : last + 1]]
                line, which = line_of(places, self._curve)
                nodes, segments, outline.fractions[first : last + 1], _ = line
                start, self._own[chain] = 0, which < 0
            lines.append((nodes, segments - start))
        starts = np.cumsum([0, *(len(nodes) for nodes, _ in lines)])
        outline.segments[:] = np.concatenate(
            [start + segments for start, (_, segments) in zip(starts, lines, strict=False)]
        )
        nodes = np.concatenate([nodes for nodes, _ in lines])
        self.__dict__["_outline"] = outline._replace(nodes=nodes)

    def _refresh(self, xy: FloatArray) -> None:
        """`start` and the sweeps know where the vertices are."""

    def _note(self, xy: FloatArray) -> None:
        """The sweeps have noted it."""
