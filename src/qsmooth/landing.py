"""The end of a run with vertices that slide: onto the places of a function; and what is told."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.constraints import Freedom
from qsmooth.curves import project
from qsmooth.kernels.rails import Rails
from qsmooth.mesh import Mesh
from qsmooth.metrics import Quality, Validity
from qsmooth.numbering import Inside
from qsmooth.outcome import Sliding
from qsmooth.outline import Chains
from qsmooth.sliding import SLACK_OF_FUNCTIONS, Places, Slider, slider_of
from qsmooth.topology import Topology

# Of the largest coordinate of a place: more than the rounding of points in a tilted plane.
ROUNDING = 2.0**-48
# A place is within reach if the square of its distance falls short of that of the reach by this
# share, as in `kernels.confining`.
REACH_ROUNDING = 2.0**-48


def land(
    slider: Slider,
    xy: FloatArray,
    forbidden: Callable[[FloatArray], BoolArray],
    chosen: BoolArray | None = None,
) -> None:
    """Put sliding vertices where the function has them that was given as curve, in place.

    It is asked once, for all of them. Those go there that keep their order on the line and their
    reach, whose cells are not forbidden and whose edges meet no other side of the boundary; where
    several would break something together they all stay.

    Parameters
    ----------
    slider
        What slides. Its `answers` are overwritten, if the curve is a function.
    xy : (n_vertices, 2)
        Coordinates in the order inside.
    forbidden
        Marks the cells, (n_cells,), that coordinates may not have.
    chosen : (n_vertices,) or None
        The vertices that may go; None for all that slide.
    """
    if slider.chains.project is None:
        return
    here = slider.where(xy)
    vertices = here.vertices
    slider.answers = _answers(slider, here, xy)
    shares = _shares(here, slider.answers)
    far = np.hypot(*(slider.answers - here.start - here.fractions[:, None] * here.way).T)
    going = (far <= np.hypot(*here.way.T)) & _in_reach(slider.rails, here, slider.answers)
    going &= (shares >= -SLACK_OF_FUNCTIONS) & (shares <= 1.0 + SLACK_OF_FUNCTIONS)
    going &= (slider.answers != xy[vertices]).any(axis=1)
    if chosen is not None:
        going &= chosen[vertices]
    met, topology = slider.meeting(xy), slider.topology
    while going.any():
        trial = xy.copy()
        trial[vertices[going]] = slider.answers[going]
        bad = slider.meeting(trial) & ~met
        bad[topology.cell_vertices[np.repeat(forbidden(trial), topology.cell_sizes)]] = True
        back = going & (bad[vertices] | _out_of_order(here, shares, going))
        if not back.any():
            xy[:] = trial
            return
        going &= ~back


def guard(
    topology: Topology, xy: FloatArray, worst: float = math.nan
) -> Callable[[FloatArray], BoolArray]:
    """Forbid cells that were valid and are not, or that came below this scaled Jacobian."""
    before = Quality(topology, xy.copy())

    def forbidden(trial: FloatArray) -> BoolArray:
        now = Quality(topology, trial)
        bad = (before.validity == Validity.VALID) & (now.validity != Validity.VALID)
        if worst > 0.0:
            jacobian = now.scaled_jacobian
            bad |= (jacobian < worst) & (jacobian < before.scaled_jacobian)
        return np.asarray(bad)

    return forbidden


def slid(
    freedom: Freedom, before: Mesh, after: Mesh, slider: Slider | None = None
) -> Sliding | None:
    """Say what became of the vertices that were to slide; None where none was.

    `slider` is what slid, where anything was set up.
    """
    if freedom.chains is None:
        return None
    slider = slider or slider_of(freedom, before, Inside(before, kept=True))
    return _not_slid(before, freedom.chains) if slider is None else _report(slider, after.xy)


def _not_slid(mesh: Mesh, chains: Chains) -> Sliding:
    """Say of lines on which nothing has moved, or can."""
    return Sliding(
        boundary_vertices=int(mesh.topology.is_boundary.sum()),
        may_slide=0,
        slid=0,
        on_curve=bool(chains.follows.any()),
        curves_unused=chains.n_unused,
        line_vertices=chains.n_on_lines,
        kept_vertices=chains.n_given,
    )


def _report(slider: Slider, after: FloatArray) -> Sliding:
    """Sum up where the vertices have come to; of coordinates in the caller's order."""
    xy, chains = slider.inside.at_vertices(after), slider.chains
    here, far = slider.where(xy), slider.deviations(xy)
    moved = (xy != slider.given).any(axis=1)[here.vertices]
    chain_of = np.repeat(np.arange(chains.on_boundary.size), np.diff(chains.offsets))[here.entries]
    on_boundary, off = chains.on_boundary[chain_of], _off(slider, here, xy)
    return replace(
        _not_slid(slider.mesh, chains),
        may_slide=int(on_boundary.sum()),
        slid=int((moved & on_boundary).sum()),
        interface_vertices=int((~on_boundary).sum()),
        interface_slid=int((moved & ~on_boundary).sum()),
        beside=int((off > 0.0).sum()),
        off_curve=float(off.max(initial=0.0)),
        deviation=float(far[:, 0].max(initial=0.0)),
        deviation_share=float(far[:, 1].max(initial=0.0)),
        along_curve=int(chains.follows[chain_of].sum()),
    )


def _off(slider: Slider, here: Places, xy: FloatArray) -> FloatArray:
    """How far each vertex is from its line, 0 for rounding, (n_sliding,)."""
    now = xy[here.vertices]
    if slider.answers is None:
        beside, target = here.off, here.start + here.fractions[:, None] * here.way
    else:
        beside, target = np.ones(len(now), np.bool_), slider.answers
    far = np.hypot(*(now - target).T)
    return np.where(beside & (far > ROUNDING * np.abs(now).max(axis=1)), far, 0.0)


def _answers(slider: Slider, here: Places, xy: FloatArray) -> FloatArray:
    """Ask the function, but for vertices at one of its places: these stay, (n_sliding, 2).

    Up to rounding, where a vertex has not moved.
    """
    assert slider.chains.project is not None
    now, given = xy[here.vertices], slider.given[here.vertices]
    answers = project(slider.chains.project, now)
    rounding = ROUNDING * np.abs(now).max(axis=1)
    still = (now == given).all(axis=1) & (np.hypot(*(answers - now).T) <= rounding)
    at_place = (here.fractions == 0.0) & (now == here.start).all(axis=1)
    stays = still | at_place
    answers[stays] = now[stays]
    return answers


def _shares(here: Places, places: FloatArray) -> FloatArray:
    """Where along its segment the place of each vertex is, as a share of that."""
    squares = (here.way**2).sum(axis=1)
    along = ((places - here.start) * here.way).sum(axis=1)
    shares: FloatArray = np.divide(along, squares, where=squares > 0.0, out=here.fractions.copy())
    return shares


def _in_reach(rails: Rails, here: Places, places: FloatArray) -> BoolArray:
    """Mark places within the reach of their vertices."""
    if not rails.origin.size:
        return np.ones(len(places), np.bool_)
    squares = ((places - rails.origin[here.vertices]) ** 2).sum(axis=1)
    reach = rails.reach[here.vertices]
    return np.asarray(squares <= reach * reach * (1.0 - REACH_ROUNDING))


def _out_of_order(here: Places, shares: FloatArray, going: BoolArray) -> BoolArray:
    """Mark vertices that would not come before the next on their line, and those."""
    share = np.where(going, shares, here.fractions)
    # Entries number the vertices of all chains; between two chains there are their ends.
    beside = np.diff(here.entries) == 1
    ordered = (here.segments[:-1] < here.segments[1:]) | (share[:-1] < share[1:])
    marked = np.zeros(share.size, np.bool_)
    wrong = np.flatnonzero(beside & ~ordered)
    marked[wrong] = marked[wrong + 1] = True
    return marked
