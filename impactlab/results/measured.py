"""Values with their standard errors as text, to the digits that mean something."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import xarray as xr


def measured_text(value: float, error: float) -> str:
    """Return a value with its standard error, to as few digits as leave the error as it is within a tenth.

    That are one or two digits of the error, such as ``0.0497 ± 0.0001`` and ``0.0497 ± 0.00014``; with a power of 10
    where both are small or large. A value without error has four digits.
    """
    if not (math.isfinite(value) and 0.0 < error < math.inf):
        return f"{value:.4g}"
    power = math.floor(math.log10(max(abs(value), error)))
    power = power if not -4 < power < 6 else 0
    value, error = value / 10.0**power, error / 10.0**power
    short = float(f"{error:.0e}")
    # rounding may change a tenth of an error: errors themselves are hardly known better
    shown = short if abs(short - error) <= 0.1 * error else float(f"{error:.1e}")
    digits = 1 - math.floor(math.log10(shown)) - (shown == short)
    places = max(0, digits)
    text = f"{round(value, digits):.{places}f} ± {shown:.{places}f}"
    return f"({text})e{power}" if power else text


_HEADLINES = ("contact_ratio", "mean_square_displacement")


def headline(result: xr.Dataset) -> str:
    """Return one number of a simulation as text: the first contact's time in contact, else a body's mean square."""
    for name in _HEADLINES:
        if name in result and result[name].size:
            error = result.get(f"{name}_standard_error")
            first = result[name][dict.fromkeys(result[name].dims, 0)]
            label = str(first[result[name].dims[-1]].item())
            known = math.nan if error is None else error.values.ravel()[0].item()
            return headline_text(name, label, first.item(), known)
    return "done"


def headline_text(name: str, label: str, value: float, error: float) -> str:
    """Return a statistic of a contact or body with its error as text."""
    return f"{name.replace('_', ' ')} of {label} {measured_text(value, error)}"
