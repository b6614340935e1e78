"""Vertices come to lie where a function that is the curve has them, at the end of a run."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from qsmooth._types import BoolArray, FloatArray
from qsmooth.curves import project
from qsmooth.kernels.rails import Rails
from qsmooth.metrics import Quality, Validity
from qsmooth.sliding import ROUNDING, SLACK_OF_FUNCTIONS, Places, Slider
from qsmooth.topology import Topology

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
    if slider.project is None:
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


def _answers(slider: Slider, here: Places, xy: FloatArray) -> FloatArray:
    """Ask the function, but for vertices at one of its places: these stay, (n_sliding, 2).

    Up to rounding, where a vertex has not moved.
    """
    assert slider.project is not None
    now, given = xy[here.vertices], slider.given[here.vertices]
    answers = project(slider.project, now)
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
