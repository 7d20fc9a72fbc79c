"""What results hold for a plot: variables, their rows by name; errors say which record makes what is missing."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, cast

import numpy as np
import xarray as xr

from impactlab.components.composition import FAMILIES, kind_of
from impactlab.components.contact import Contact, ContactLaw, HertzContact, RoundContact
from impactlab.components.sides import Combination
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.inputs import suggestion
from impactlab.results.dataset import CONFIGURATION, configuration_of
from impactlab.results.schema import BODY, CONTACT, POINT, STATE, check_labels
from impactlab.results.snapshot import recorded
from impactlab.results.stack import DONE, number_of, on_own_axes

LARGEST = 1e100
"""Size of the largest number that is drawn: the square of one is a number, and so is the length of an axis."""

LABELS = (BODY, CONTACT, POINT, STATE)
"""Dimensions whose labels are names of members of a network."""


def known_dataset(result: Any) -> xr.Dataset:
    """Return a result along its own axes; refuse what is none, and a point of a sweep that was not simulated."""
    if not isinstance(result, xr.Dataset):
        raise InvalidInput(f"A plot takes the dataset that il.simulate or il.sweep returned, not {type(result)!r}.")
    if "status" in result and result["status"].ndim == 0 and result["status"].item() != DONE:
        raise InvalidInput(f"Nothing was simulated at this point of the sweep: {result['status'].item()}")
    check_labels(result)
    return on_own_axes(result)


def variable(result: Any, name: str, what: str, record: str, inner: Iterable[str]) -> xr.DataArray:
    """Return a variable of one simulation that a record makes.

    Parameters
    ----------
    result : Dataset
    name : str
        Name of the variable.
    what : str
        Description of the variable, for the error if it is missing.
    record : str
        How to ask for the variable, for the same error.
    inner : iterable of str
        Dimensions allowed besides the dimensions of names.
    """
    dataset = known_dataset(result)
    if name not in dataset:
        raise InvalidInput(f"The result holds no {what}; ask for it with simulate(…, record=[{record}]).")
    found, inner = of_names(dataset[name]), list(inner)
    known = {*inner, *map(number_of, inner), *LABELS}
    if further := [str(item) for item in found.dims if item not in known]:
        example = ", ".join(f"{item}=…" for item in further)
        raise InvalidInput(f"The result is one over {', '.join(further)}: select a point of it, result.sel({example}).")
    for item in (found, *found.coords.values()):
        _check_numbers(item)
    return found


def _check_numbers(data: xr.DataArray) -> None:
    """Refuse numbers that no axis can have; NaN stands where there are none, but for times."""
    if data.dtype.kind != "f" or not data.size:
        return
    least, largest = float(data.min()), float(data.max())
    if max(abs(least), abs(largest)) > LARGEST or (data.name == "time" and not np.isfinite(data).all()):
        raise InvalidInput(f"{data.name} cannot be drawn: it has numbers from {least:g} to {largest:g}.")


def of_names(data: xr.DataArray) -> xr.DataArray:
    """Return a variable of some bodies, contacts or points with the dimension that one of all of them has."""
    return data.rename({recorded(name): name for name in LABELS if recorded(name) in data.coords})


def names_of(data: xr.DataArray) -> tuple[str, list[str]]:
    """Return the dimension of a variable that has names, and the names; one that was selected counts, too."""
    dimension = next(name for name in LABELS if name in data.coords)
    return dimension, [str(name) for name in np.atleast_1d(data[dimension].values)]


def rows(data: xr.DataArray, names: str | Iterable[str] | None = None) -> Iterator[tuple[str, dict[str, str]]]:
    """Give the names of what a variable is known of, and what selects each; all that were recorded by default."""
    dimension, known = names_of(data)
    whole = dimension in data.dims
    recorded = [name for name in known if np.isfinite(data.sel({dimension: name} if whole else {}).values).any()]
    for name in recorded if names is None else several(names):
        if name not in recorded:
            why = "was not recorded" if name in known else f"is not in the result; {suggestion(str(name), recorded)}"
            raise InvalidInput(f"{name!r} {why}")
        yield name, {dimension: name} if whole else {}


def several(names: Any) -> list[Any]:
    """Return one or several names as a list, of which there must be one."""
    if isinstance(names, str | Combination):
        return [names]
    found = list(names) if isinstance(names, Iterable) else []
    if not found:
        raise InvalidInput(f"A plot takes the name of a body, point or contact, or a list of names, not {names!r}.")
    return found


def law_with(method: str, reference: Any) -> Any:
    """Return the function of a law that is drawn beside a result, or refuse what has none."""
    if not hasattr(reference, method):
        what = method.replace("_", " ")
        raise InvalidInput(f"reference is a law that knows the {what}, such as il.exact(network), not {reference!r}.")
    return getattr(reference, method)


def error_of(result: xr.Dataset, name: str, place: Mapping[str, Any]) -> np.ndarray:
    """Return the standard errors of a row of a variable; 0 where there are none, so that bands are lines."""
    error = f"{name}_standard_error"
    if error not in result:
        return np.zeros(result[name].sel(place).shape)
    return np.asarray(np.nan_to_num(result[error].sel(place).values))


def configuration(result: xr.Dataset) -> dict[str, Any]:
    """Return the stored configuration of a result as plain data; empty if the result has lost it."""
    return configuration_of(result) if CONFIGURATION in {*result.attrs, *result.variables} else {}


@contextlib.contextmanager
def reading_stored() -> Iterator[None]:
    """Refuse a stored configuration that was changed to something else than impactlab writes."""
    try:
        yield
    except (AttributeError, ImpactLabError, LookupError, TypeError, ValueError) as error:
        raise InvalidInput(
            f"The configuration that is stored with the result is damaged ({error}); simulate again, or remove its "
            f"attribute {CONFIGURATION!r} to draw without contacts."
        ) from error


@reading_stored()
def impulsive_contacts(result: xr.Dataset) -> set[str]:
    """Return the names of impulsive contacts, whose forces are means over the interval before each sample."""
    contacts = configuration(result).get("network", {}).get("contacts", {})
    known = {kind.__name__ for kind in _kinds_of(ContactLaw) if kind.impulsive}
    return {str(name) for name, contact in contacts.items() if contact["law"]["type"].rpartition(".")[2] in known}


def _kinds_of(family: type[ContactLaw]) -> Iterator[type[ContactLaw]]:
    """Yield the classes of a family that are imported."""
    for kind in family.__subclasses__():
        yield kind
        yield from _kinds_of(kind)


@reading_stored()
def contacts_of(result: xr.Dataset) -> dict[str, Contact | RoundContact]:
    """Return the contacts of the network of a result.

    Their laws are others, so that classes of laws need not be known.
    """
    contacts = configuration(result).get("network", {}).get("contacts", {})
    law = HertzContact(1.0)
    made = {
        str(name): kind_of(item, FAMILIES["contacts"]).from_dict({**item, "law": law})
        for name, item in contacts.items()
    }
    found = cast("dict[str, Contact | RoundContact]", made)
    for name, item in found.items():
        if isinstance(item.clearance, float) and abs(item.clearance) > LARGEST:
            raise ValueError(f"the clearance of {name!r} is {item.clearance:g} m")
    return found


@reading_stored()
def structures_of(result: xr.Dataset) -> set[str]:
    """Return the names of the structures of the network of a result: bodies of other names stand for each."""
    return set(configuration(result).get("network", {}).get("oscillators", {})) - set(names_of(result[BODY])[1])
