"""Rails: where each vertex may be. Nothing here loads Numba: a run's constraints are told by these.

Each vertex may have a line through where it was, along which alone it moves, and a reach, the
radius of a disc around where it was.
"""

from typing import NamedTuple

import numpy as np

from qsmooth._types import FloatArray


class Rails(NamedTuple):
    """Where each vertex may be. Empty where all may be anywhere.

    Attributes
    ----------
    origin : (n_vertices, 2)
        Where it was.
    reach : (n_vertices,)
        How far from there it may be, a length; infinite for any distance.
    direction : (n_vertices, 2)
        Unit vector along which alone it may move from there; NaN for any direction.
    """

    origin: FloatArray
    reach: FloatArray
    direction: FloatArray


# Nothing holds any vertex.
FREE = Rails(np.empty((0, 2)), np.empty(0), np.empty((0, 2)))
