"""Metrics: a record each, every cell's figures, their summary, gates and provable bounds."""

from qsmooth.metrics.bounds import Limits, angle_limits, limits
from qsmooth.metrics.gates import Check, check_gate, check_validity, parse_gate
from qsmooth.metrics.histogram import Histogram
from qsmooth.metrics.metric import Cells, Metric
from qsmooth.metrics.quality import Quality, Validity, quality
from qsmooth.metrics.registry import METRICS, find_metric, parse_metrics
from qsmooth.metrics.summary import Summary, WorstCells

__all__ = [
    "METRICS",
    "Cells",
    "Check",
    "Histogram",
    "Limits",
    "Metric",
    "Quality",
    "Summary",
    "Validity",
    "WorstCells",
    "angle_limits",
    "check_gate",
    "check_validity",
    "find_metric",
    "limits",
    "parse_gate",
    "parse_metrics",
    "quality",
]
