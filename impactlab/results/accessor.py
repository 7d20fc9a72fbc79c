"""What impactlab does with a dataset as its own: a summary, a table, plots.

``result.impactlab.plot.density("two")`` is ``il.plot.density(result, "two")``.
"""

from __future__ import annotations

import functools
import html
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

import impactlab
from impactlab.errors import InvalidInput
from impactlab.results.measured import measured_text
from impactlab.results.schema import EVERY, Statistic
from impactlab.results.stack import DONE

_OF_NETWORKS = {"network", "network_html"}
"""Plots that are not of datasets."""

ROWS_OF_SUMMARY = 24
"""Rows of a table that a summary shows."""

_SETTINGS = {
    "realizations": "{} realization(s)", "duration": "duration {} s", "step": "step {} s", "spin_up": "spin-up {} s",
}  # fmt: skip
"""What a summary tells of a run."""


class Accessor:
    """What impactlab does with a dataset, under its name ``impactlab``.

    Parameters
    ----------
    dataset : Dataset
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset, self.plot = dataset, Plots(dataset)

    def __repr__(self) -> str:
        heading, table, remarks = _summary(self._dataset)
        shown = [] if table is None else [table.to_string(index=False)]
        return "\n".join([heading, *shown, *remarks])

    def _repr_html_(self) -> str:
        heading, table, remarks = _summary(self._dataset)
        shown = "" if table is None else table.to_html(index=False, border=0)
        parts = [f"<p>{html.escape(text)}</p>" for text in (heading, *remarks)]
        return f"<div>{parts[0]}{shown}{''.join(parts[1:])}</div>"

    def table(self) -> pd.DataFrame:
        """Return the default statistics as a table, a row for each statistic of a body, contact or point.

        Returns
        -------
        pandas.DataFrame
            With the columns statistic, label, value, standard_error (NaN where there is none) and units; of a sweep
            the values of its parameters come first.

        Raises
        ------
        InvalidInput
            If the dataset holds no statistics.
        """
        dataset = self._dataset
        held = [item for item in EVERY.values() if item.name in dataset]
        if not held:
            raise InvalidInput("The dataset holds no statistics: give what il.simulate, il.sweep or il.exact returned.")
        return pd.concat([_rows_of(dataset, item) for item in held], ignore_index=True)


class Plots:
    """The functions of `il.plot` for one dataset, which they take as their first argument.

    Parameters
    ----------
    dataset : Dataset
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def __repr__(self) -> str:
        return f"il.plot of this dataset: {', '.join(f'.{name}(…)' for name in dir(self))}"

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_") or name not in dir(self):
            raise AttributeError(f"il.plot draws no {name!r} of a dataset; it draws {', '.join(dir(self))}.")
        return functools.partial(getattr(impactlab.plot, name), self._dataset)

    def __dir__(self) -> list[str]:
        return sorted(set(impactlab.plot.__all__) - _OF_NETWORKS)


def _rows_of(dataset: xr.Dataset, statistic: Statistic) -> pd.DataFrame:
    """Return the rows of one statistic."""
    value = dataset[statistic.name]
    error = dataset[statistic.error] if statistic.error in dataset else xr.full_like(value, np.nan)
    both = xr.Dataset({"value": value, "standard_error": error})
    if statistic.dimension not in both.dims:  # one that was selected
        both = both.expand_dims(statistic.dimension)
    others = [name for name in both.dims if name != statistic.dimension]
    frame = both.reset_coords(drop=True).to_dataframe(dim_order=[*others, statistic.dimension]).reset_index()
    frame.insert(len(others), "statistic", statistic.name)
    return frame.rename(columns={statistic.dimension: "label"}).assign(units=statistic.units)


def _summary(dataset: xr.Dataset) -> tuple[str, pd.DataFrame | None, list[str]]:
    """Return a heading, a table of values with their errors as text, and what else is to be said."""
    heading = ", ".join(_settings(dataset)) or str(dataset.attrs.get("title", "dataset"))
    try:
        table = Accessor(dataset).table()
    except InvalidInput:
        return heading, None, ["It holds no statistics."]
    shown = table.head(ROWS_OF_SUMMARY)
    values = [measured_text(*pair) for pair in zip(shown["value"], shown["standard_error"], strict=True)]
    remarks = [f"These are {ROWS_OF_SUMMARY} of {len(table)} rows."] if len(table) > ROWS_OF_SUMMARY else []
    remarks += [*_warnings(dataset), "As a table: .table(); pictures: .plot."]
    return heading, shown.drop(columns="standard_error").assign(value=values), remarks


def _settings(dataset: xr.Dataset) -> Iterator[str]:
    """Give what a summary tells of a run, or of the points of a sweep."""
    for name, coordinate in dataset.coords.items():
        if coordinate.ndim == 0:  # a part that was selected
            yield f"{name} = {coordinate.item()}"
    if "status" in dataset and dataset["status"].ndim:
        done = dataset["status"].values == DONE
        yield f"{np.count_nonzero(done)} of {done.size} points done"
    for name, text in _SETTINGS.items():
        given = np.asarray(dataset[name] if name in dataset else dataset.attrs.get(name, np.nan), dtype=float)
        if np.isfinite(given).any():
            limits = dict.fromkeys(f"{limit(given):.6g}" for limit in (np.nanmin, np.nanmax))
            yield text.format(" to ".join(limits))


def _warnings(dataset: xr.Dataset) -> Iterator[str]:
    """Give the warnings of a run, of each kind one."""
    if "warnings" not in dataset or "warning" not in dataset.coords:
        return
    for kind in dataset["warning"].values.tolist():
        texts = [text for text in dataset["warnings"].sel(warning=kind).values.ravel().tolist() if text]
        if texts:
            more = f" (of {len(texts)} points the first)" if len(texts) > 1 else ""
            yield f"Warning: {texts[0]}{more}"
