"""The plots of a dataset as its own: ``result.impactlab.plot.density("two")`` is ``il.plot.density(result, "two")``."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import xarray as xr

import impactlab

_OF_NETWORKS = {"network", "network_html"}
"""Plots that are not of datasets."""


class Accessor:
    """What impactlab does with a dataset, under its name ``impactlab``.

    Parameters
    ----------
    dataset : Dataset
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self.plot = Plots(dataset)


class Plots:
    """The functions of `il.plot` for one dataset, which they take as their first argument.

    Parameters
    ----------
    dataset : Dataset
    """

    def __init__(self, dataset: xr.Dataset) -> None:
        self._dataset = dataset

    def __getattr__(self, name: str) -> Callable[..., Any]:
        if name.startswith("_") or name not in dir(self):
            raise AttributeError(f"il.plot draws no {name!r} of a dataset; it draws {', '.join(dir(self))}.")
        return functools.partial(getattr(impactlab.plot, name), self._dataset)

    def __dir__(self) -> list[str]:
        return sorted(set(impactlab.plot.__all__) - _OF_NETWORKS)
