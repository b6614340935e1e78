"""A variable of a NetCDF file, of either form."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

# Text is a str, numbers are arrays.
Attributes: TypeAlias = dict[str, Any]


@dataclass
class Variable:
    """A variable; `values` reads it, in the machine's byte order."""

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    attributes: Attributes
    values: Callable[[], npt.NDArray[Any]]

    def text(self, attribute: str) -> str:
        """An attribute as text; "" where it is not there or no text."""
        value = self.attributes.get(attribute, "")
        return value.strip("\0 ") if isinstance(value, str) else ""


def widened(attributes: Attributes) -> None:
    """Give those attributes that must be of the variable's type the type float64."""
    for name in ("_FillValue", "missing_value", "valid_min", "valid_max", "valid_range"):
        if name in attributes and not isinstance(attributes[name], str):
            attributes[name] = np.asarray(attributes[name], np.float64)
