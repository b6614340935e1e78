"""Every method that is registered keeps what all promise, with any of its options, on any mesh."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import promises
from meshes import random_mesh, random_meshes, renumber
from qsmooth.registry import all_methods

every_method = pytest.mark.parametrize("known", all_methods().values(), ids=all_methods())


@every_method
@given(st.data())
@settings(max_examples=60)
def test_on_valid_meshes(known, data):
    mesh = data.draw(promises.valid_meshes())
    promises.check(mesh, data.draw(promises.methods(known, repeatable=False)))


@every_method
@given(st.data())
@settings(max_examples=30)
def test_on_tangled_meshes(known, data):
    mesh = data.draw(promises.tangled_meshes())
    promises.check(mesh, data.draw(promises.methods(known)))


# A second thread that waits for a core makes many short sweeps slow: few of them, and few examples.
@every_method
@given(st.data())
@settings(max_examples=12)
def test_the_bits_are_the_same_however_it_runs(known, data):
    mesh = data.draw(promises.valid_meshes() | promises.tangled_meshes())
    method = data.draw(promises.methods(known, most_sweeps=25))
    if not method.why_not(mesh):
        promises.bits_are_the_same(mesh, method)


@every_method
@given(
    promises.rough_meshes(),
    st.data(),
    st.sampled_from([1e-12, 1.0, 3e7]),
    st.floats(0.0, 6.0),
    st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0)),
    st.booleans(),
)
@settings(max_examples=25)
def test_results_turn_scale_shift_and_mirror_with_the_input(
    known, made, data, scale, turn, shift, mirror
):
    # With the defaults: bad_step=2, for one, mirrors a vertex between its neighbours, so that its
    # clearance is exactly what it was and rounding decides. In any unit that is a power of two the
    # bits are the same with any options; see the next test.
    method = known(max_sweeps=data.draw(st.integers(1, 4)))
    if not method.why_not(made.mesh):
        promises.follows_the_input(made, method, scale=scale, turn=turn, shift=shift, mirror=mirror)


@every_method
@given(random_meshes(), st.data(), st.integers(-40, 40))
@settings(max_examples=15)
def test_scaling_by_a_power_of_two_scales_the_bits(known, made, data, power):
    method = data.draw(promises.methods(known))
    if not method.why_not(made.mesh):
        promises.scales_by_bits(made, method, power)


@every_method
@given(promises.rough_meshes(size=7), st.integers(0, 2**32 - 1))
@settings(max_examples=15)
def test_another_numbering_breaks_nothing(known, made, seed):
    method = known(max_sweeps=60)
    renumbered = renumber(made.points, made.cells, np.random.default_rng(seed))
    if not method.why_not(made.mesh):
        promises.numbering_breaks_nothing(made, *renumbered, method)


@every_method
@pytest.mark.parametrize("kind", ["triangles", "mixed"])
def test_there_are_meshes_that_it_takes(known, kind):
    assert not known().why_not(random_mesh(kind, 3).mesh)
