"""Studies of impactlab's own numerics: run time, accuracy, conservation, coverage, scaling, stability, trust."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_HOME = {
    "AccuracyStudy": "accuracy",
    "ConservationStudy": "conservation",
    "CoverageStudy": "coverage",
    "ScalingStudy": "scaling",
    "StabilityStudy": "stability",
    "TrustStudy": "trust",
    "WorkPrecisionStudy": "work_precision",
}
"""The folder of each study."""

__all__ = [
    "AccuracyStudy",
    "ConservationStudy",
    "CoverageStudy",
    "ScalingStudy",
    "StabilityStudy",
    "TrustStudy",
    "WorkPrecisionStudy",
]


def __getattr__(name: str) -> Any:
    """Import a study when it is first asked for."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOME[name]}.study"), name)
