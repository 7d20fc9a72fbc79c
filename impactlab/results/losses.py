"""Realizations that left the range of finite numbers, as a dataset names them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab.results.labels import Variables, labelled

LOSSES, DIVERGED = "realizations_diverged", "diverged_realization"
"""Name of the attribute with the number of lost realizations, and of the variable with their numbers."""

ADVICE = "Use a smaller step, or check the forces."
"""What to do about realizations that diverge."""


class Loss(NamedTuple):
    """When and where a realization left the range of finite numbers."""

    realization: int
    time: float  # at the end of its first step without finite numbers, negative in the spin-up (s)
    oscillator: str
    contact: str  # with the largest force on this body then; empty if none acts on it

    def text(self) -> str:
        """Return it in words."""
        contact = f", pushed by contact {self.contact!r}" if self.contact else ""
        who = f"{self.oscillator!r} of realization {self.realization}"
        return f"{who} left the range of finite numbers at t = {self.time:.6g} s{contact}."


def losses_text(losses: Sequence[Loss], number: int) -> str:
    """Say how many of so many realizations were lost, and when and where the first of them."""
    first = min(losses, key=lambda loss: loss.time).text()
    return f"{len(losses)} of {number} realizations diverged; the first: {first}" if number > 1 else first


def with_losses(
    variables: Variables, attributes: dict[str, Any], losses: Sequence[Loss], places: np.ndarray, number: int
) -> tuple[Variables, dict[str, Any]]:
    """Return variables and attributes of a run with its losses: values of these realizations are NaN.

    `places` are the places of the other realizations among so many.
    """
    if not losses:
        return variables, attributes
    whole = {name: (dims, _spread(dims, values, places, number), attrs)
             for name, (dims, values, attrs) in variables.items()}  # fmt: skip
    each = ("diverged",)
    realizations, times, oscillators, contacts = map(np.array, zip(*sorted(losses), strict=True))
    whole[DIVERGED] = labelled(each, realizations, "1", "number of a realization that left the range of finite numbers")
    whole["diverged_time"] = labelled(each, times, "s", "time at which it did, negative in the spin-up")
    whole["diverged_oscillator"] = labelled(each, oscillators, "", "oscillator that did")
    whole["diverged_contact"] = labelled(each, contacts, "", "contact with the largest force on it then")
    survivors = f"Statistics are those of the {number - len(losses)} of {number} realizations that stay finite."
    return whole, {**attributes, LOSSES: len(losses), "condition": survivors}


def without_losses(dataset: xr.Dataset) -> xr.Dataset:
    """Return a dataset without the values of realizations that were lost, which are NaN."""
    if DIVERGED not in dataset or "realization" not in dataset.dims:
        return dataset
    return _without(dataset, dataset[DIVERGED].values)


def without_losses_of_either(one: xr.Dataset, other: xr.Dataset) -> tuple[xr.Dataset, xr.Dataset]:
    """Return two datasets without realizations that were lost in one of them, so that pairs stay pairs."""
    lost = [item[DIVERGED].values for item in (one, other) if DIVERGED in item]
    if not lost:
        return one, other
    numbers = np.concatenate(lost)
    return _without(one, numbers), _without(other, numbers)


def _without(dataset: xr.Dataset, numbers: np.ndarray) -> xr.Dataset:
    """Return a dataset without realizations of some numbers."""
    return dataset.sel(realization=~np.isin(dataset["realization"].values, numbers))


def refuse_losses(states: Any) -> None:
    """Refuse final states, as starts, among which are those of realizations that were lost."""
    if DIVERGED not in states or "realization" not in states.coords:
        return
    lost = np.intersect1d(states["realization"].values, states[DIVERGED].values)
    if lost.size:
        some = ", ".join(map(str, lost[:3].tolist())) + (", …" if len(lost) > 3 else "")
        raise InvalidInput(
            f"initial: {len(lost)} realizations of the earlier run diverged, so that they have no end: {some}. "
            "Leave them out: result.dropna('realization', subset=['final_displacement'])."
        )


def _spread(dims: Sequence[str], values: Any, places: np.ndarray, number: int) -> Any:
    """Return values of realizations at their places among so many, NaN at the others; values of all as they are."""
    if "realization" not in dims:
        return values
    axis, values = list(dims).index("realization"), np.asarray(values)
    if values.shape[axis] == number:
        return values
    shape = list(values.shape)
    shape[axis] = number
    whole = np.full(shape, np.nan)
    whole[(slice(None),) * axis + (places,)] = values
    return whole
