"""`docs/comparison.md` and the README say of the methods what is in the stored results."""

import copy
import runpy
from pathlib import Path

import pytest

from qsmooth.registry import methods

ROOT = Path(__file__).resolve().parent.parent
STUDY = runpy.run_path(str(ROOT / "studies" / "methods.py"), run_name="study")
FOUND = STUDY["stored"]()
MESHES = FOUND["meshes"]


def test_the_page_has_the_stored_figures():
    page = STUDY["PAGE"].read_text(encoding="utf-8")
    for name in ("methods", "hold"):
        assert page.count(STUDY["START"].format(name)) == 1
        assert page.count(STUDY["END"].format(name)) == 1
    assert STUDY["with_parts"](page, FOUND) == page


@pytest.mark.parametrize(
    "path",
    [
        ("meshes", "spiral", "optimize", "min_angle"),  # in the table
        ("meshes", "superior_24k", "optimize", "aspect_ratio"),  # in what is said of it
        ("held_notch", "min_angle"),
        ("hold_and_target", 1, "max_angle"),
    ],
)
def test_another_figure_is_another_page(path):
    page = STUDY["PAGE"].read_text(encoding="utf-8")
    found = copy.deepcopy(FOUND)
    *way, name = path
    at = found
    for step in way:
        at = at[step]
    at[name] *= 0.5
    assert STUDY["with_parts"](page, found) != page


def test_every_mesh_and_method_is_in_the_stored_run():
    assert list(MESHES) == list(STUDY["TITLES"])
    assert set(STUDY["MESHES"]) < set(MESHES)
    for name, by_method in MESHES.items():
        without = set() if "triangle" in STUDY["TITLES"][name] else {"aspect-ratio"}
        assert set(by_method) == {"before", *methods()} - without


def test_what_is_said_of_the_optimiser_is_so():
    for name, by_method in MESHES.items():
        best = by_method["optimize"]
        for method in STUDY["SHOWN"]:
            assert by_method[method]["min_angle"] <= best["min_angle"]
            if (name, method) != ("simple_case", "laplacian"):
                assert by_method[method]["max_angle"] >= best["max_angle"]
        assert best["invalid"] == 0
    assert FOUND["held_notch"]["aspect_ratio"] <= MESHES["notch"]["before"]["aspect_ratio"]


def test_what_is_said_of_the_other_methods_is_so():
    for by_method in MESHES.values():
        if by_method["before"]["invalid"]:
            continue
        for method in set(by_method) - {"laplacian"}:
            assert by_method[method]["invalid"] == 0
    triangles = {method: MESHES["random_triangles"][method] for method in methods()}
    assert min(triangles, key=lambda m: triangles[m]["aspect_ratio"]) == "aspect-ratio"
    simple = {method: MESHES["simple_case"][method] for method in methods()}
    assert max(simple, key=lambda m: simple[m]["max_angle"]) == "aspect-ratio"
    for method in ("star", "quad"):
        assert MESHES["tangled"][method]["invalid"] > 0
        for mesh in ("spiral", "lake"):
            jumps = MESHES[mesh]
            assert jumps[method]["size_jump"] > jumps["laplacian"]["size_jump"]


def test_the_readme_has_the_stored_figures():
    readme = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    (given, reached) = (
        f"{found['min_angle']:.1f}° to {found['max_angle']:.1f}°"
        for found in (MESHES["superior_24k"][method] for method in ("before", "optimize"))
    )
    assert f"24K quads of {given}, `optimize` reaches {reached}" in readme
