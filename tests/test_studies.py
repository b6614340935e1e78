"""The studies name nothing that has gone: they are run by hand, and seldom."""

import runpy
from pathlib import Path

import pytest

STUDIES = sorted((Path(__file__).resolve().parent.parent / "studies").glob("*.py"))


def test_there_are_studies():
    assert {"methods", "subset", "targets", "triangles"} <= {path.stem for path in STUDIES}


@pytest.mark.parametrize("path", STUDIES, ids=lambda path: path.stem)
def test_everything_imported_is_there(path):
    assert callable(runpy.run_path(str(path), run_name="imported")["main"])
