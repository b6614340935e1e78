"""Scratch memory of the guarded sweeps: rows of lanes, beside those of `lanes`."""

from qsmooth.kernels.blocks import lane_row
from qsmooth.kernels.lanes import N_ROWS

# Of each vertex the longest and shortest edge, and the star's largest coordinate; the clearance to
# keep, and the tolerated loss. Of a trial whether it is certified, its score and edge ratio, both
# squared, and its clearance. The score to reach and the edge ratio to keep; whether all corners
# are certified where the vertex is. 1 where lanes together can not tell, and the place to store.
(
    LONGEST, SHORTEST, LARGEST, LEAST, LOSS, CERTAIN, SCORE, RATIO, KEPT, ENOUGH, MOST_RATIO,
    WAS_CERTAIN, LONE, NEW_X, NEW_Y,
) = (lane_row(N_ROWS + k) for k in range(15))  # fmt: skip
# Two proposals and their clearances; what was accepted, summed up, and its weight; at which
# multiple of its moves a cell proposes; how often a trial was refused by the edge ratio alone.
(
    FIRST_X, FIRST_Y, FIRST_KEPT, SECOND_X, SECOND_Y, SECOND_KEPT, SUM_X, SUM_Y, WEIGHT,
    STRIDE, BY_RATIO,
) = (lane_row(N_ROWS + 15 + k) for k in range(11))  # fmt: skip
N_GUARD_ROWS = N_ROWS + 26
# Rows of a guard line: distance of v from it, and the gradient of that distance. A quad has three,
# a→c, a→b, b→c, and a triangle one; those of the quads come first.
LINE_X, LINE_Y = lane_row(1), lane_row(2)
LINE, LINE2, QUAD_LINES = lane_row(3), lane_row(6), lane_row(9)
ROWS_OF_LINES = 9
