"""Comparison of statistics with a reference."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab.inputs import checked
from impactlab.results.schema import EVERY, STATISTICS, Statistic, check_labels


class Reference(Protocol):
    """What knows the statistics of a network, such as an `ExactReference`."""

    def statistics(self) -> xr.Dataset: ...


@checked
def compare(result: xr.Dataset, reference: xr.Dataset | Reference) -> xr.Dataset:
    """Compare the statistics of a result with those of a reference.

    Parameters
    ----------
    result : Dataset
        What `simulate` returned.
    reference : Dataset, ExactReference or FokkerPlanckReference
        A reference, its statistics, or the result of another simulation.

    Returns
    -------
    xarray.Dataset
        One row along ``comparison`` for each statistic and each label that both have,
        with the coordinates ``statistic``, ``label`` (of the body or the contact) and
        ``units``, the first columns of `to_dataframe`, and the variables

        - ``value`` and ``standard_error``: of the result, NaN if it has none;
        - ``reference``;
        - ``difference``: value minus reference;
        - ``relative_difference``: divided by the size of the reference, NaN if that is 0;
        - ``z``: difference in standard errors, which include those of the reference, or the numerical
          errors of `fokker_planck`, if it has some; NaN where there are none, or where they are 0.

    Raises
    ------
    InvalidInput
        If one is not a dataset, the two have no statistic and label in common, or a
        statistic has further dimensions.

    Examples
    --------
    >>> result = il.simulate(network, 20.0, realizations=64, rng=1)
    >>> rows = il.compare(result, il.exact(network))
    >>> bool(abs(rows.z).max() < 4.5)
    True
    """
    if not isinstance(reference, xr.Dataset):
        reference = reference.statistics()
    for dataset in (result, reference):
        check_labels(dataset)
    rows = [row for statistic in EVERY.values() for row in _rows(statistic, result, reference)]
    if not rows:
        raise InvalidInput(
            "The result and the reference have no statistic of the same body or contact in common; "
            f"each needs one of {', '.join(STATISTICS)}."
        )
    statistic, label, units, *numbers = zip(*rows, strict=True)
    value, error, expected, combined = (np.array(column, dtype=float) for column in numbers)
    difference = value - expected
    columns = {
        "value": (value, "value of the result"),
        "standard_error": (error, "standard error of the result"),
        "reference": (expected, "value of the reference"),
        "difference": (difference, "result minus reference"),
        "relative_difference": (
            _ratio(difference, np.abs(expected)),
            "difference over size of the reference",
        ),
        "z": (_ratio(difference, combined), "difference in combined standard errors"),
    }
    labels = {"statistic": statistic, "label": label, "units": units}
    rows_of = xr.Dataset(coords={name: ("comparison", list(data)) for name, data in labels.items()})
    return rows_of.assign(  # after the labels, which are so the first columns of `to_dataframe`
        {name: ("comparison", data, {"long_name": text}) for name, (data, text) in columns.items()}
    )


def _rows(statistic: Statistic, result: xr.Dataset, reference: xr.Dataset) -> list[tuple[Any, ...]]:
    """Return the rows of one statistic; the last item is the combined standard error."""
    name, dimension = statistic.name, statistic.dimension
    if name not in result or name not in reference:
        return []
    for dataset in (result, reference):
        if dataset[name].dims != (dimension,):
            raise InvalidInput(
                f"{name} has the dimensions {dataset[name].dims}; compare takes one simulation: "
                f"select one, so that {dimension!r} is left."
            )
    known = reference[dimension].values.tolist()
    labels = [label for label in result[dimension].values.tolist() if label in known]
    rows = []
    for label in labels:
        place = {dimension: label}
        value, expected = (float(dataset[name].sel(place)) for dataset in (result, reference))
        error, other = (_standard_error(dataset, statistic, place) for dataset in (result, reference))
        combined = np.nan if error is None and other is None else np.hypot(error or 0.0, other or 0.0)
        rows.append((name, label, statistic.units, value, np.nan if error is None else error, expected, combined))
    return rows


def _standard_error(dataset: xr.Dataset, statistic: Statistic, place: dict[str, str]) -> float | None:
    """Return the standard error, or the numerical one, of a statistic; None if it has neither."""
    found = [name for name in (statistic.error, f"{statistic.name}_error") if name in dataset]
    return float(dataset[found[0]].sel(place)) if found else None


def _ratio(numerator: np.ndarray, denominator: np.ndarray) -> np.ndarray:
    """Return the ratio, and NaN where the denominator is 0 or NaN."""
    ratio = np.full_like(numerator, np.nan)
    return np.asarray(np.divide(numerator, denominator, out=ratio, where=denominator > 0.0))
