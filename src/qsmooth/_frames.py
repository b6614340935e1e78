"""Columns as a data frame, where pandas is there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def data_frame(columns: Mapping[str, Any], index: Any, name: str) -> Any:
    """Make a ``pandas.DataFrame`` of columns with an index of that name.

    Raises
    ------
    ImportError
        Where there is no pandas.
    """
    try:
        import pandas
    except ImportError as error:
        raise ImportError(
            "to_dataframe() makes a DataFrame of pandas: pip install pandas"
        ) from error
    return pandas.DataFrame(columns, index=pandas.Index(index, name=name))
