"""Sheets of quads."""

import numpy as np

from qsmooth import examples
from qsmooth.targets import Sheets


def test_every_quad_is_on_two_sheets():
    mesh = examples.structured(5, 3)
    offsets, links, closed = Sheets(mesh.topology, mesh.xy).order
    assert sorted(links.tolist()) == list(range(30))
    assert sorted(np.diff(offsets).tolist()) == [3] * 5 + [5] * 3
    assert not closed.any()
