"""The seed paper, "Quadrilateral Mesh Smoothing": its table and figures, made again.

`runs` has the paper's own numbers and makes ours, `drawing` the figures, `page` what is said of
both.
"""

from qsmooth.paper.drawing import FIGURES, PaperFigure, draw
from qsmooth.paper.page import write_page
from qsmooth.paper.runs import Runs, run

__all__ = ["FIGURES", "PaperFigure", "Runs", "draw", "run", "write_page"]
