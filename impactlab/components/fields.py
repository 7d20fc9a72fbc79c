"""How fields of components are declared, and how they are looked at."""

from __future__ import annotations

import dataclasses
import functools
import inspect
from collections.abc import Callable
from typing import Any, NamedTuple


def parameter(
    default: Any = dataclasses.MISSING,
    *,
    units: str = "1",
    minimum: float | None = None,
    above: float | None = None,
    maximum: float | None = None,
    kw_only: bool | dataclasses._MISSING_TYPE = dataclasses.MISSING,
) -> Any:
    """Declare a field of a component.

    Parameters
    ----------
    default : optional
        Value of the field when it is not given. Without it the field is required.
    units : str
        Units in the notation of UDUNITS, such as ``"N m-1"``.
    minimum, maximum : float, optional
        Smallest and largest value allowed.
    above : float, optional
        The value must be larger than this.
    kw_only : bool, optional
        Whether the field must be given by name. By default all fields but the
        first of a class must.

    Returns
    -------
    dataclasses.Field

    Examples
    --------
    >>> class Cone(il.ContactLaw):
    ...     stiffness: float = il.parameter(units="N m-2", above=0.0)
    ...
    ...     @staticmethod
    ...     def force(indentation, stiffness):
    ...         return stiffness * indentation * indentation
    >>> Cone.units_of("stiffness")
    'N m-2'
    """
    metadata = {"units": units, "minimum": minimum, "above": above, "maximum": maximum}
    return dataclasses.field(default=default, metadata=metadata, kw_only=kw_only)  # type: ignore[call-overload]


def state(
    start: Any = dataclasses.MISSING,
    *,
    units: str = "1",
    minimum: float | None = None,
    above: float | None = None,
    maximum: float | None = None,
) -> Any:
    """Declare a state of a law: a number that each member has in each realization, and that the motion changes.

    It changes when a step is accepted, to what the kernel ``update`` of the law returns. The field of a
    component holds the value at the start, and is given by name.

    Parameters
    ----------
    start : float
        Value at the start of a run, unless a component is made with another.
    units : str
        Units in the notation of UDUNITS, such as ``"m"``.
    minimum, maximum, above : float, optional
        Limits of the value at the start, as of a `parameter`.

    Returns
    -------
    dataclasses.Field

    Examples
    --------
    >>> class Yielding(il.ContactLaw):
    ...     loading: float = il.parameter(units="N m-1", above=0.0)
    ...     largest: float = il.state(0.0, units="m")
    ...
    ...     @staticmethod
    ...     def update(indentation, largest):
    ...         return max(indentation, largest)
    ...
    ...     @staticmethod
    ...     def force(indentation, loading, largest):
    ...         return max(loading * (4.0 * indentation - 3.0 * largest), 0.0)
    >>> Yielding(1e4).state_names()
    ('largest',)
    """
    metadata = {"units": units, "minimum": minimum, "above": above, "maximum": maximum, "state": True}
    return dataclasses.field(default=start, metadata=metadata, kw_only=True)


def make_first_field_positional(cls: type) -> None:
    """Let the first field that a class itself declares be given by position, unless all are said to be ``KW_ONLY``."""
    inherited = {name for base in cls.__mro__[1:] for name in inspect.get_annotations(base)}
    for name, kind in inspect.get_annotations(cls).items():
        if "KW_ONLY" in str(kind):
            return
        value = cls.__dict__.get(name, dataclasses.MISSING)
        if name in inherited or "ClassVar" in str(kind):
            continue
        if not isinstance(value, dataclasses.Field):
            value = dataclasses.field(default=value)
            setattr(cls, name, value)
        if value.kw_only is dataclasses.MISSING:
            value.kw_only = False
        return


class Declared(NamedTuple):
    """A field of a class, as it is looked at whenever a component is made."""

    name: str
    place: str
    kind: str
    positional: bool
    needed: bool
    state: bool
    units: str
    limits: dict[str, float]  # by a key of `LIMITS`


def _fields_of(cls: Any) -> tuple[Declared, ...]:
    result = []
    for field in dataclasses.fields(cls):
        kind = str(field.type if isinstance(field.type, str) else getattr(field.type, "__name__", field.type))
        needed = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        given = {name: value for name, value in field.metadata.items() if value is not None}
        limits = {name: given[name] for name in ("minimum", "above", "maximum") if name in given}
        place, units = f"{cls.__name__}.{field.name}", given.get("units", "1")
        result.append(Declared(field.name, place, kind, not field.kw_only, needed, "state" in given, units, limits))
    return tuple(result)


declared_by: Callable[[Any], tuple[Declared, ...]] = functools.cache(_fields_of)
