"""What travels together of sparse matrices. Nothing here loads Numba."""

from typing import NamedTuple

from qsmooth._types import IndexArray, SingleArray, TableArray


class Graph(NamedTuple):
    """The rows of a sparse matrix.

    Attributes
    ----------
    offsets, columns : (n + 1,), (n_blocks,)
        CSR map.
    """

    offsets: IndexArray
    columns: TableArray


class Shares(NamedTuple):
    """What rows take of others, or hand to them: a sparse matrix of numbers.

    Attributes
    ----------
    offsets, columns : (n + 1,), (n_shares,)
        CSR map.
    values : (n_shares,)
        0 to 1.
    """

    offsets: IndexArray
    columns: TableArray
    values: SingleArray
