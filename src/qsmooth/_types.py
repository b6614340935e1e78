"""The array types of the package."""

from typing import TypeAlias

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
IndexArray: TypeAlias = npt.NDArray[np.int64]
# The tables that sweeps read: half the memory traffic of int64, and no wrap-around test per access.
TableArray: TypeAlias = npt.NDArray[np.uint32]
# The table of blocks; unsigned, as what is computed from it are offsets of lanes.
BlockArray: TypeAlias = npt.NDArray[np.uint64]
# Colours of vertices.
ColourArray: TypeAlias = npt.NDArray[np.int8]
# Moves that are noted for later, as shares of a length; what they are for needs no more digits.
MoveArray: TypeAlias = npt.NDArray[np.float32]
# Values of a matrix that only has to show the way, and vectors that go with it.
SingleArray: TypeAlias = npt.NDArray[np.float32]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
