"""One pass over the cells after a round: the same bits as from the kernels of each figure."""

import numpy as np
import pytest

import reference
import reference_optimizer as slow
from meshes import KINDS, random_mesh
from qsmooth.kernels._jit import use_threads
from qsmooth.metrics import Quality
from qsmooth.optimizer.look import Look
from qsmooth.targets import Targets, ideal, initial


def look_at(mesh, targets, movable):
    counts = targets.size_weight > 0.0
    inv_area = np.divide(1.0, targets.area, out=np.zeros(counts.size), where=counts)
    sizes = np.stack([inv_area, targets.size_weight], axis=1)
    maps = np.empty((0, 3)) if targets.maps is None else targets.maps
    return Look(mesh.topology, mesh.xy, movable, targets, sizes, maps), sizes, maps


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("amount", [0.3, 1.5], ids=["valid", "tangled"])
@pytest.mark.parametrize("aim", ["ideal", "initial"])
@pytest.mark.parametrize("threads", [1, 2])
def test_one_pass_gives_the_bits_of_many(kind, amount, aim, threads):
    from qsmooth.kernels.cell_energy import cell_energy

    mesh = random_mesh(kind, 6, seed=3, amount=amount).mesh
    topology, n = mesh.topology, mesh.n_cells
    targets: Targets = ideal(topology) if aim == "ideal" else initial(topology, mesh.xy)
    movable = np.random.default_rng(5).random(mesh.n_vertices) < 0.7
    with use_threads(threads):
        look, sizes, maps = look_at(mesh, targets, movable)
    badness, energy = np.empty(n), np.empty(n)
    cell_energy(mesh.xy, *topology.cells, movable, targets.corners, sizes, maps, badness, energy)
    np.testing.assert_array_equal(look.badness, badness)
    np.testing.assert_array_equal(look.energy, energy)
    plain = Quality(topology, mesh.xy)
    for name in ("shape", "area", "validity"):
        np.testing.assert_array_equal(getattr(look.quality, name), getattr(plain, name))
    for percent in (0.0, 20.0, 50.0, 90.0):
        assert look.quality.low_angle(percent) == plain.low_angle(percent)
    assert look.quality.extreme_angles == plain.extreme_angles


@pytest.mark.nojit
@pytest.mark.parametrize("kind", ["quads", "triangles", "mixed"])
def test_worst_shape_is_that_of_the_worst_corner_towards_its_target(kind):
    mesh = random_mesh(kind, 3, seed=11, amount=0.8).mesh
    cells, places = reference.as_lists(mesh), mesh.xy.tolist()
    for maps in (False, True):
        asked = slow.random_asked(cells, np.random.default_rng(0), maps=maps)
        owns = [slow.asked_of(cell, asked) for cell in cells]
        corners = [own.targets[v] for cell, own in zip(cells, owns, strict=True) for v in cell]
        asked_maps = [own.map[[0, 0, 1], [0, 1, 1]] for own in owns]
        targets = ideal(mesh.topology)._replace(
            corners=np.array(corners), maps=np.array(asked_maps) if maps else None
        )
        look, _, _ = look_at(mesh, targets, np.ones(mesh.n_vertices, np.bool_))
        for c, (cell, own) in enumerate(zip(cells, owns, strict=True)):
            energies = [
                slow.shape_energy(
                    *map(own.mapped, slow.edges_at(places, cell, i)), own.targets[cell[i]]
                )
                for i in range(len(cell))
            ]
            assert look.worst_shape[c] == pytest.approx(max(energies), rel=1e-12)
    look, _, _ = look_at(mesh, ideal(mesh.topology), np.ones(mesh.n_vertices, np.bool_))
    assert 1.0 / look.worst_shape == pytest.approx(look.quality.shape, rel=1e-12)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("percent", [0.0, 1.0, 37.0, 100.0])
def test_low_angles_are_a_percentile_of_the_smallest(kind, percent):
    found = Quality((mesh := random_mesh(kind, 6, seed=3, amount=0.3).mesh).topology, mesh.xy)
    expected = np.percentile(found.min_angle, percent)
    assert found.low_angle(percent) == pytest.approx(expected, rel=1e-14)


def test_a_look_is_of_its_coordinates_alone():
    mesh = random_mesh("mixed", 4, seed=1, amount=0.3).mesh
    xy = mesh.xy.copy()
    look = Look(
        mesh.topology, xy, np.ones(mesh.n_vertices, bool), ideal(mesh.topology),
        np.zeros((mesh.n_cells, 2)), np.empty((0, 3)),
    )  # fmt: skip
    assert look.is_of(mesh.xy)
    xy[0] += 1e-9
    assert not look.is_of(xy)
    assert look.is_of(mesh.xy)
