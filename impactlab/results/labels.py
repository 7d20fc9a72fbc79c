"""Variables of xarray, with units and standard errors."""

from __future__ import annotations

import numpy as np

Labelled = tuple[tuple[str, ...], np.ndarray, dict[str, str]]
"""Dimensions, values and attributes."""

Variables = dict[str, Labelled]
"""Variables by name."""


def words(name: str) -> str:
    """Return a name as words, for readers of a file."""
    return name.replace("_", " ")


def labelled(dimensions: tuple[str, ...], values: np.ndarray, units: str, long_name: str) -> Labelled:
    """Return a variable, without units if these are empty."""
    return dimensions, values, {**({"units": units} if units else {}), "long_name": long_name}


def with_error(
    name: str, dimensions: tuple[str, ...], values: np.ndarray, errors: np.ndarray | None, units: str, long_name: str
) -> Variables:
    """Return a variable and that of its standard errors, if there are any."""
    of_error, own = f"{name}_standard_error", labelled(dimensions, values, units, long_name)
    if errors is None:
        return {name: own}
    own[2]["ancillary_variables"] = of_error
    return {name: own, of_error: labelled(dimensions, errors, units, f"standard error of {long_name}")}
