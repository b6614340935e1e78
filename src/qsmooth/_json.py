"""What JSON can't hold, made fit for it."""

from __future__ import annotations

import math
from typing import Any


def finite(value: Any) -> Any:
    """Make nested lists and dicts fit for JSON: numbers that are not finite become None."""
    if isinstance(value, dict):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if hasattr(value, "tolist"):
        return finite(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
