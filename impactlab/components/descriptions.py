"""Components that describe many: with distributions in the place of numbers."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import impactlab


def of_numbers(check: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return a check of components that tries numbers of its range in the place of an uncertain number.

    A component with an uncertain number is marked as such.
    """

    @functools.wraps(check)
    def checked(self: Any) -> None:
        values = vars(self)
        for name, value in values.items():
            if isinstance(value, Mapping | list | tuple):
                object.__setattr__(self, name, _read(value))
        if any(map(_is_uncertain, values.values())):
            _check_range(self)
        else:
            check(self)
        if any(map(_is_uncertain, values.values())):  # also in parts that the check has made
            object.__setattr__(self, "is_uncertain", True)

    return checked


def uncertain_in(component: Any, place: str = "") -> dict[str, Any]:
    """Return the uncertain numbers in a component by their places, such as ``law.stiffness``."""
    return dict(_places(component, place))


def with_numbers(component: Any, numbers: Mapping[str, float], place: str = "") -> Any:
    """Return a component with numbers in the place of uncertain ones, by the places that `uncertain_in` names."""
    if isinstance(component, tuple):
        return tuple(with_numbers(item, numbers, f"{place}.{index}") for index, item in enumerate(component))
    if not _is_uncertain(component):
        return component
    if isinstance(component, impactlab.Uncertain):
        return numbers.get(place, component)
    fields = {name: getattr(component, name) for name in component.field_names()}
    before = f"{place}." if place else ""
    return type(component)(**{name: with_numbers(item, numbers, f"{before}{name}") for name, item in fields.items()})


def _is_uncertain(value: Any) -> bool:
    """Whether the value of a field is uncertain, or something in it."""
    if type(value) is tuple:
        return any(map(_is_uncertain, value))
    return getattr(value, "is_uncertain", False) is True


def _read(value: Any) -> Any:
    """Return the value of a field with uncertain numbers in the place of stored ones."""
    if isinstance(value, Mapping):
        return impactlab.Uncertain.from_dict(value) if value.get("type") == "Uncertain" else value
    read = tuple(_read(item) if isinstance(item, Mapping) else item for item in value)
    return read if _is_uncertain(read) else value


def _places(value: Any, place: str) -> Iterator[tuple[str, Any]]:
    if isinstance(value, tuple):
        for index, item in enumerate(value):
            yield from _places(item, f"{place}.{index}")
    elif _is_uncertain(value) and isinstance(value, impactlab.Uncertain):
        yield place, value
    elif _is_uncertain(value):
        for name in value.field_names():
            yield from _places(getattr(value, name), f"{place}.{name}" if place else name)


def _check_range(component: Any) -> None:
    """Refuse a component that cannot be made at the ends of the range of one of its numbers."""
    found = {place: item for name in component.field_names() for place, item in _places(getattr(component, name), name)}
    filled = functools.partial(_made_of, component)
    middle = {place: item.median for place, item in found.items()}
    for place, item in found.items():
        low, high = item.range
        for value in (low, item.median, high):
            try:
                filled({**middle, place: value})
            except impactlab.InvalidInput as error:
                raise impactlab.InvalidInput(
                    f"{type(component).__name__}.{place} is drawn from {low:.6g} to {high:.6g}, by {item!r}, but "
                    f"{error} Use a distribution that ends before, such as scipy.stats.truncnorm."
                ) from None
    made = filled(middle)
    for name in component.field_names():
        if not _is_uncertain(getattr(component, name)):
            object.__setattr__(component, name, getattr(made, name))  # in its declared type


def _made_of(component: Any, numbers: Mapping[str, float]) -> Any:
    fields = {name: with_numbers(getattr(component, name), numbers, name) for name in component.field_names()}
    return type(component)(**fields)
