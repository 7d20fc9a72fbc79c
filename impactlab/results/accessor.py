"""What impactlab does with a dataset as its own: a summary, a table, plots.

``result.impactlab.plot.density("two")`` is ``il.plot.density(result, "two")``.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import pandas as pd
import xarray as xr

import impactlab
from impactlab.results.table import html_of, table_of, text_of

_OF_NETWORKS = {"network", "network_html"}
"""Plots that are not of datasets."""


class Accessor:
    """What impactlab does with a dataset, under its name ``impactlab``.

    Parameters
    ----------
    dataset : Dataset
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset, self.plot = dataset, Plots(dataset)

    def __repr__(self) -> str:
        return text_of(self._dataset)

    def _repr_html_(self) -> str:
        return html_of(self._dataset)

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
        return table_of(self._dataset)


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
