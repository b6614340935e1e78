"""Meshes cut into parts for ranks."""

import numpy as np

from qsmooth import DistributedMesh


def cell_corners(mesh):
    """Vertices of each cell, padded with -1, (n_cells, 4)."""
    rows = np.full((mesh.n_cells, 4), -1)
    first = 0
    for block in mesh.cells:
        rows[first : first + len(block), : block.shape[1]] = block
        first += len(block)
    return rows


def blocks_of_rows(mesh, n):
    """Cells in as many runs of their numbers."""
    return np.arange(mesh.n_cells) * n // mesh.n_cells


def round_robin(mesh, n):
    """One cell to each rank in turn: an absurd partition."""
    return np.arange(mesh.n_cells) % n


def all_on_the_first(mesh, n):
    """Other ranks have nothing at all."""
    return np.zeros(mesh.n_cells, int)


def part_of(mesh, cell_rank, comm, *, ghosts=False):
    """What one rank has of a mesh; with ghosts also all cells around its vertices."""
    rows = cell_corners(mesh)
    own = cell_rank == comm.rank
    if ghosts and own.any():
        own |= np.isin(rows, np.unique(rows[own][rows[own] >= 0])).any(axis=1)
    cells = np.flatnonzero(own)
    vertices = np.unique(rows[cells][rows[cells] >= 0])
    if comm.rank == 0:  # vertices that no cell uses have to be somewhere
        unused = np.flatnonzero(~np.isin(np.arange(mesh.n_vertices), rows[rows >= 0]))
        vertices = np.union1d(vertices, unused)
    local = np.full(mesh.n_vertices + 1, -1)
    local[vertices] = np.arange(vertices.size)
    quads = rows[cells][:, 3] >= 0
    blocks = [local[rows[cells][quads]], local[rows[cells][~quads]][:, :3]]
    ids = np.concatenate([cells[quads], cells[~quads]])
    regions = None if mesh.regions is None else mesh.regions[ids]
    return DistributedMesh(
        mesh.points[vertices],
        blocks,
        vertices,
        ids,
        comm,
        fixed=mesh.topology.given_fixed[vertices],
        regions=regions,
    )
