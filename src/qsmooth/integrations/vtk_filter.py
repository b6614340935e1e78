"""Filters for VTK's pipeline, one for each method; in ParaView this file is a plugin.

``StarFilter`` smooths by star, ``OptimizeFilter`` by optimize; `FILTERS` has them all, by the names
of the methods. ``SetStep`` and ``GetStep`` stand for the option ``step``, and so for every field.

ParaView (Tools, Manage Plugins, Load New) shows them among its filters, where its Python has
qsmooth.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar
from xml.sax.saxutils import escape, quoteattr

from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkOutputWindow
from vtkmodules.vtkCommonDataModel import vtkDataObject

from qsmooth.adapters import as_mesh
from qsmooth.adapters.vtk_dataset import CLASSES
from qsmooth.integrations.dataset_reading import Reading
from qsmooth.methods.base import Method
from qsmooth.options import Options, Spec, spelled
from qsmooth.registry import all_methods
from qsmooth.result import SmoothResult

try:
    from paraview.util.vtkAlgorithm import smdomain, smproperty, smproxy
except ImportError:  # VTK alone
    smproxy = None

__all__ = ["FILTERS", "MethodFilter"]

paraview_plugin_name = "qsmooth"
paraview_plugin_version = "1"

# How ParaView calls what holds values of a kind; all others are texts.
PROPERTIES = {"number": "Double", "integer": "Int", "flag": "Int"}


class MethodFilter(VTKPythonAlgorithmBase):  # type: ignore[misc]
    """Moves the points of a dataset by one method; its output is of the class of its input.

    Attributes
    ----------
    method
        The class of the method.
    result
        The last `SmoothResult`; None before, and where the input could not be smoothed, which
        VTK's output window is told.
    """

    method: ClassVar[type[Method]]

    def __init__(self) -> None:
        super().__init__(nInputPorts=1, inputType=CLASSES[0], nOutputPorts=1, outputType=CLASSES[0])
        self.result: SmoothResult | None = None
        self._options: dict[type[Options], dict[str, Any]] = {Reading: {}, self.method: {}}

    def FillInputPortInformation(self, port: int, info: Any) -> int:  # noqa: N802
        """Take what the adapter takes."""
        info.Remove(self.INPUT_REQUIRED_DATA_TYPE())
        for name in CLASSES:
            info.Append(self.INPUT_REQUIRED_DATA_TYPE(), name)
        return 1

    def FillOutputPortInformation(self, port: int, info: Any) -> int:  # noqa: N802
        """Promise points and cells; `RequestDataObject` makes them of the right class."""
        info.Set(vtkDataObject.DATA_TYPE_NAME(), "vtkPointSet")
        return 1

    def RequestDataObject(self, request: Any, inputs: Any, outputs: Any) -> int:  # noqa: N802
        """Make an empty output of the class of the input."""
        given, place = self.GetInputData(inputs, 0, 0), outputs.GetInformationObject(0)
        there = place.Get(vtkDataObject.DATA_OBJECT())
        if there is None or there.GetClassName() != given.GetClassName():
            place.Set(vtkDataObject.DATA_OBJECT(), given.NewInstance())
        return 1

    def RequestData(self, request: Any, inputs: Any, outputs: Any) -> int:  # noqa: N802
        """Smooth."""
        self.result = None
        given = self.GetInputData(inputs, 0, 0)
        try:
            mesh = as_mesh(given, surface=Reading.of(self._options[Reading]).surface)
            self.result = self.method.of(self._options[self.method]).smooth(mesh)
        except ValueError as error:
            vtkOutputWindow.GetInstance().DisplayErrorText(f"{type(self).__name__}: {error}")
            return 0
        self.GetOutputData(outputs, 0).ShallowCopy(self.result.back())
        return 1

    def _set(self, owner: type[Options], spec: Spec, given: Any) -> None:
        options = self._options[owner]
        value = _value(spec, given)
        owner.of({**options, spec.name: value})  # refuses it at once
        if options.get(spec.name, spec.default) != value:
            options[spec.name] = value
            self.Modified()

    def _get(self, owner: type[Options], spec: Spec) -> Any:
        return self._options[owner].get(spec.name, spec.default)


def _value(spec: Spec, given: Any) -> Any:
    """Make a value of what VTK and ParaView give: texts where they have no better."""
    if given is None:  # ParaView's empty text
        return spec.default
    if spec.kind == "flag" and isinstance(given, int):
        return bool(given)
    if not isinstance(given, str):
        return given
    if not given.strip() and (spec.optional or spec.kind == "object"):
        return spec.default
    if spec.kind == "choice":
        return {str(choice): choice for choice in spec.choices}.get(given, given)
    if spec.kind in ("number", "integer"):
        try:
            return float(given) if spec.kind == "number" else int(given)
        except ValueError:
            return given  # which the option refuses in its own words
    if spec.parse is None:
        return given
    return spec.parse([part.strip() for part in given.split(",")] if spec.repeats else given)


def _camel(name: str) -> str:
    return "".join(word.capitalize() for word in name.split("_"))


def _accessors(owner: type[Options], spec: Spec) -> tuple[Callable[..., None], Callable[..., Any]]:
    """What sets an option of a filter, and what gets it."""

    def setter(self: MethodFilter, value: Any) -> None:
        self._set(owner, spec, value)

    def getter(self: MethodFilter) -> Any:
        return self._get(owner, spec)

    for function, verb in ((setter, "Set"), (getter, "Get")):
        function.__name__ = f"{verb}{_camel(spec.name)}"
        function.__doc__ = spelled(spec.help)
    return setter, getter


def _xml(spec: Spec) -> str:
    """Describe an option to ParaView."""
    kind = "" if spec.optional else PROPERTIES.get(spec.kind, "")
    default: Any = spec.default
    if not kind:
        default = str(default) if spec.kind == "choice" and default is not None else ""
    elif spec.kind == "flag":
        default = int(default)
    domain = '<BooleanDomain name="bool"/>' if spec.kind == "flag" else ""
    if spec.kind == "choice":
        texts = [""] * spec.optional + [str(choice) for choice in spec.choices]
        choices = "".join(f"<String value={quoteattr(text)}/>" for text in texts)
        domain = f'<StringListDomain name="list">{choices}</StringListDomain>'
    tag = f"{kind or 'String'}VectorProperty"
    words = quoteattr(spec.name.replace("_", " ").capitalize())
    return (
        f'<{tag} name="{_camel(spec.name)}" label={words} command="Set{_camel(spec.name)}" '
        f'number_of_elements="1" default_values={quoteattr(str(default))}>'
        f"{domain}<Documentation>{escape(spelled(spec.help))}</Documentation></{tag}>"
    )


def _filter_of(method: type[Method]) -> Any:
    """Make the filter of a method; in ParaView, as its decorators leave it."""
    body: dict[str, Any] = {"method": method, "__doc__": method.purpose, "__module__": __name__}
    for owner in (Reading, method):
        for spec in owner.specs().values():
            if spec.flag is None:
                continue  # a function, or the like
            setter, getter = _accessors(owner, spec)
            body[getter.__name__] = getter
            body[setter.__name__] = (
                setter if smproxy is None else smproperty.xml(_xml(spec))(setter)
            )
    made: Any = type(f"{method.__name__}Filter", (MethodFilter,), body)
    if smproxy is not None:
        made = smdomain.datatype(dataTypes=list(CLASSES), composite_data_supported=False)(made)
        made = smproperty.input(name="Input", port_index=0)(made)
        made = smproxy.filter(label=f"qsmooth: {method.title}")(made)
    return made


FILTERS: dict[str, Any] = {name: _filter_of(method) for name, method in all_methods().items()}
globals().update({f"{method.__name__}Filter": FILTERS[n] for n, method in all_methods().items()})
