"""Meshes to try the package on, of any size, from a formula and a seed.

The same arguments give the same mesh.
"""

from qsmooth.examples.grids import (
    around_body,
    boundary_layer,
    bump,
    distorted,
    jittered,
    notch,
    random_interior,
    structured,
    tangled,
)
from qsmooth.examples.lakes import lake
from qsmooth.examples.spirals import DEMO_FILE, demo_mesh, spiral
from qsmooth.examples.triangles import random_triangles, simple_case

__all__ = [
    "DEMO_FILE",
    "around_body",
    "boundary_layer",
    "bump",
    "demo_mesh",
    "distorted",
    "jittered",
    "lake",
    "notch",
    "random_interior",
    "random_triangles",
    "simple_case",
    "spiral",
    "structured",
    "tangled",
]
