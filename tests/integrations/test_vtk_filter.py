"""Filters in a real pipeline of VTK, and what ParaView is told of them."""

import importlib.util
import sys
import types
from xml.etree import ElementTree

import numpy as np
import pytest

pytest.importorskip("vtkmodules")
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkOutputWindow, vtkPoints, vtkStringOutputWindow
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData, vtkUnstructuredGrid
from vtkmodules.vtkCommonTransforms import vtkTransform
from vtkmodules.vtkFiltersCore import vtkAppendFilter
from vtkmodules.vtkFiltersGeneral import vtkTransformFilter

from object_samples import POINTS, QUADS
from qsmooth import smooth
from qsmooth.integrations import vtk_filter
from qsmooth.integrations.vtk_filter import FILTERS
from qsmooth.registry import all_methods

SPACE = np.column_stack([POINTS, np.zeros(len(POINTS))])


@pytest.fixture
def poly():
    data = vtkPolyData()
    points = vtkPoints()
    points.SetData(numpy_to_vtk(SPACE, deep=True))
    data.SetPoints(points)
    cells = vtkCellArray()
    for quad in QUADS.tolist():
        cells.InsertNextCell(4, quad)
    data.SetPolys(cells)
    bed = numpy_to_vtk(POINTS[:, 0].copy(), deep=True)
    bed.SetName("bed")
    data.GetPointData().AddArray(bed)
    return data


@pytest.fixture
def said():
    """What VTK would show in its window."""
    before, window = vtkOutputWindow.GetInstance(), vtkStringOutputWindow()
    vtkOutputWindow.SetInstance(window)
    yield window
    vtkOutputWindow.SetInstance(before)


def points_of(data):
    return vtk_to_numpy(data.GetPoints().GetData())


def test_in_a_pipeline(poly):
    shift = vtkTransformFilter()
    shift.SetTransform(vtkTransform())
    shift.SetInputData(poly)
    star = vtk_filter.StarFilter()
    star.SetInputConnection(shift.GetOutputPort())
    star.SetMaxSweeps(3)
    after = vtkAppendFilter()
    after.AddInputConnection(star.GetOutputPort())
    after.Update()
    expected = smooth(poly, "star", max_sweeps=3)
    assert np.array_equal(points_of(after.GetOutput()), expected.points)
    assert after.GetOutput().GetPointData().HasArray("bed")
    assert isinstance(star.GetOutputDataObject(0), vtkPolyData)
    assert star.result.sweeps == expected.sweeps
    # It runs again when an option has changed, and only then.
    first = star.result
    star.SetMaxSweeps(3)
    after.Update()
    assert star.result is first
    star.SetMaxSweeps(1)
    after.Update()
    assert star.result.sweeps == 1


def test_the_output_is_of_the_class_of_the_input(poly):
    one = FILTERS["laplacian"]()
    one.SetMaxSweeps(1)
    one.SetInputDataObject(poly)
    one.Update()
    assert isinstance(one.GetOutputDataObject(0), vtkPolyData)
    append = vtkAppendFilter()
    append.AddInputData(poly)
    append.Update()
    one.SetInputDataObject(append.GetOutput())
    one.Update()
    assert isinstance(one.GetOutputDataObject(0), vtkUnstructuredGrid)
    assert np.array_equal(points_of(one.GetOutputDataObject(0)), one.result.points)


@pytest.mark.parametrize("name", all_methods())
def test_options_are_the_fields_of_the_method(name):
    method, one = all_methods()[name], FILTERS[name]()
    assert type(one).__name__ == f"{method.__name__}Filter"
    assert type(one) is getattr(vtk_filter, type(one).__name__)
    for spec in method.specs().values():
        getter = getattr(one, "Get" + spec.name.title().replace("_", ""), None)
        assert (getter is None) == (spec.flag is None)
        assert getter is None or getter() == spec.default
    time = one.GetMTime()
    one.SetTimeLimit(2.5)
    assert one.GetMTime() > time
    assert one.GetTimeLimit() == 2.5


def test_texts_stand_for_values_and_none():
    one = vtk_filter.OptimizeFilter()
    one.SetTimeLimit("7.5")
    assert one.GetTimeLimit() == 7.5
    one.SetTimeLimit("")
    assert one.GetTimeLimit() is None
    one.SetTimeLimit(2.0)
    one.SetTimeLimit(None)  # what ParaView makes of an empty text
    assert one.GetTimeLimit() is None
    one.SetKeepInterfaces(0)
    assert one.GetKeepInterfaces() is False
    one.SetInterpolate("bed,flow")
    assert one.GetInterpolate() == ("bed", "flow")
    one.SetInterpolate(None)
    assert one.GetInterpolate() == one.method().interpolate
    star = vtk_filter.StarFilter()
    star.SetSplitQuads("False")
    assert star.GetSplitQuads() is False


def test_a_wrong_value_is_refused_when_it_is_set():
    star = vtk_filter.StarFilter()
    for setter, value, words in (
        (star.SetStep, 3.0, "step must be in"),
        (star.SetStep, "wide", "step must be a number"),
        (star.SetGuard, "all", "guard must be 'quality'"),
        (star.SetSurface, "round", "surface must be 'auto' or 'flat'"),
    ):
        with pytest.raises(ValueError, match=words):
            setter(value)
    assert star.GetStep() == 0.5 or star.GetStep() == star.method().step


def test_a_surface_that_is_not_flat(poly, said):
    points_of(poly)[:, 2] = POINTS[:, 0] ** 2
    star = vtk_filter.StarFilter()
    star.SetMaxSweeps(1)
    star.SetInputDataObject(poly)
    star.Update()
    assert star.result is None
    assert "StarFilter: the points do not lie in one plane" in said.GetOutput()
    star.SetSurface("flat")
    star.Update()
    assert star.result.sweeps == 1


class Decorators:
    """What ParaView's decorators are called with; they give functions that make the class."""

    def __init__(self):
        self.calls = []

    def __getattr__(self, name):
        def decorate(*texts, **given):
            def over(thing):
                self.calls.append((name, thing, *texts, given))
                return thing

            return over

        return decorate


@pytest.fixture(scope="module")
def plugin():
    """The file as ParaView loads it: by itself, under a name of its own; and what it was told."""
    package, util = types.ModuleType("paraview"), types.ModuleType("paraview.util")
    algorithm = types.ModuleType("paraview.util.vtkAlgorithm")
    for name in ("smproxy", "smproperty", "smdomain"):
        setattr(algorithm, name, Decorators())
    with pytest.MonkeyPatch.context() as patch:
        for module in (package, util, algorithm):
            patch.setitem(sys.modules, module.__name__, module)
        spec = importlib.util.spec_from_file_location("qsmooth_plugin", vtk_filter.__file__)
        loaded = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded)  # as ParaView does: it is in no table of modules
        assert "qsmooth_plugin" not in sys.modules
        yield loaded, algorithm


def properties(plugin, method):
    """The description of each option of a method's filter, by its name there."""
    loaded, algorithm = plugin
    own = vars(loaded.FILTERS[method])
    calls = [call for call in algorithm.smproperty.calls if call[0] == "xml"]
    nodes = [(call[1], ElementTree.fromstring(call[2])) for call in calls]
    assert all(node.get("command") == setter.__name__ for setter, node in nodes)
    return {n.get("name"): n for setter, n in nodes if own.get(setter.__name__) is setter}


def test_paraview_is_told_of_every_method(plugin):
    algorithm = plugin[1]
    labels = {thing.method.name: given["label"] for _, thing, given in algorithm.smproxy.calls}
    assert labels == {n: f"qsmooth: {m.title}" for n, m in all_methods().items()}
    inputs = [thing for name, thing, *_ in algorithm.smproperty.calls if name == "input"]
    assert inputs == list(plugin[0].FILTERS.values())
    assert {tuple(given["dataTypes"]) for *_, given in algorithm.smdomain.calls} == {
        ("vtkPolyData", "vtkUnstructuredGrid", "vtkStructuredGrid")
    }


def test_paraview_is_told_of_options_as_they_are(plugin):
    found = properties(plugin, "star")
    assert found["Step"].tag == "DoubleVectorProperty"
    assert found["MaxSweeps"].get("default_values") == "50"
    assert "Sweeps at most" in found["MaxSweeps"].findtext("Documentation")
    assert found["KeepInterfaces"].find("BooleanDomain") is not None
    assert [s.get("value") for s in found["Guard"].iter("String")] == ["quality", "clearance"]
    assert found["TimeLimit"].tag == "StringVectorProperty"
    assert found["TimeLimit"].get("default_values") == ""


@pytest.mark.parametrize("name", all_methods())
def test_what_paraview_sets_at_first_are_the_defaults(plugin, name):
    method, one = all_methods()[name], plugin[0].FILTERS[name]()
    found = properties(plugin, name)
    options = {n.title().replace("_", "") for n, s in method.specs().items() if s.flag is not None}
    assert set(found) == {"Surface", *options}
    for node in found.values():
        kind = {"DoubleVectorProperty": float, "IntVectorProperty": int}.get(node.tag, str)
        getattr(one, node.get("command"))(kind(node.get("default_values")))
    assert one.method.of(one._options[one.method]) == method()
