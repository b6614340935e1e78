"""Files of a megabyte, made on purpose of nothing but sections: two seconds each at most."""

import warnings

import pytest

from crafted_files import MANY, SECTIONS, one_card_an_element

CRAFTED = {**SECTIONS, **MANY, "cards.inp": one_card_an_element}


@pytest.mark.benchmark(group="files made to take long")
@pytest.mark.parametrize("name", CRAFTED)
def test_crafted_file(benchmark, tmp_path, name):
    from qsmooth import read_mesh

    path = tmp_path / name
    path.write_text(CRAFTED[name](), encoding="utf-8")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        benchmark.pedantic(read_mesh, args=(path,), rounds=2, warmup_rounds=1)
