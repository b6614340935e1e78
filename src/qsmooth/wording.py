"""Sentences about what was found and done, for people; no code reads them."""

from __future__ import annotations

from qsmooth.metrics import Limits


def limits_lines(limits: Limits) -> list[str]:
    """Say which angles are reached, and which no placement can beat: one line for each end."""
    return str(limits).splitlines()
