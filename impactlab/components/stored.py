"""Networks as the text that results keep, of members that have much in common."""

from __future__ import annotations

import functools
import itertools
import json
from collections.abc import Iterator, Mapping
from json.encoder import encode_basestring_ascii as quoted
from operator import attrgetter
from typing import Any, NamedTuple, Protocol

from impactlab.components.component import Component, plain

_FEW = 4
"""Members of a family up to which nothing is gained."""


class Given(Protocol):
    """A network; see `impactlab.components.composition.Composition`."""

    def given(self) -> Mapping[str, Mapping[str, Component]]: ...
    def to_dict(self) -> dict[str, Any]: ...


class Stored(NamedTuple):
    """A network as results keep it."""

    parts: tuple[str, ...]  # of what JSON makes of `Given.to_dict`
    names: tuple[str, ...]  # of the classes of all components, as the text has them


def stored(network: Given) -> Stored:
    """Return a network as results keep it; what many members have in common is written once."""
    if max(map(len, network.given().values())) <= _FEW:
        data = network.to_dict()
        return Stored((json.dumps(data),), tuple(dict.fromkeys(named_in(data))))
    writer = _Writer()
    families = [(f"{quoted(title)}: {{", writer.members(family), "}, ") for title, family in network.given().items()]
    return Stored(("{", *itertools.chain(*families[:-1]), *families[-1][:2], "}}"), tuple(writer.names))


def json_of(data: Mapping[str, Any]) -> str:
    """Return plain data and networks as they are stored, by name, as a text in JSON."""
    parts = ["{"]
    for number, (name, item) in enumerate(data.items()):
        parts += [f"{', ' if number else ''}{quoted(name)}: "]
        parts += item.parts if isinstance(item, Stored) else [json.dumps(item)]
    return "".join([*parts, "}"])


def named_in(data: Any) -> Iterator[str]:
    """Give the names of all classes in plain data and in networks as they are stored."""
    if isinstance(data, Stored):
        yield from data.names
        return
    if isinstance(data, dict):
        if isinstance(name := data.get("type"), str):
            yield name
        data = data.values()
    for value in data:
        if isinstance(value, dict | list | tuple):
            yield from named_in(value)


class _Writer:
    """Writes components and the values of their fields as JSON, many at a time."""

    def __init__(self) -> None:
        self.names: dict[str, None] = {}

    def members(self, family: Mapping[str, Component]) -> str:
        """Return members by name."""
        columns = _texts(list(family)), self.values(list(family.values()))
        return ", ".join([f"{name}: {item}" for name, item in zip(*columns, strict=True)])

    def values(self, values: list[Any]) -> list[str]:
        """Return components or values of a field; what several have in common is written once."""
        kinds = dict.fromkeys(map(type, values))
        if len(kinds) == 1 and str in kinds:
            return _texts(values)
        keys = list(map(id, values))
        distinct, known = dict(zip(keys, values, strict=True)), dict[int, str]()
        for kind in kinds:
            own = distinct if len(kinds) == 1 else {at: value for at, value in distinct.items() if type(value) is kind}
            known.update(zip(own, self._of_kind(kind, list(own.values())), strict=True))
        return list(map(known.__getitem__, keys))

    def _of_kind(self, kind: Any, values: list[Any]) -> list[str]:
        if issubclass(kind, Component) and kind.to_dict is Component.to_dict:
            name, fields = kind.stored_name(), kind.field_names()
            self.names[name] = None
            columns = [self.values(list(map(attrgetter(field), values))) for field in fields]
            form = _form(kind, name)
            return [form % row for row in zip(*columns, strict=True)] if fields else [form] * len(values)
        data = [plain(value) for value in values] if kind is not float else values
        self.names |= dict.fromkeys(named_in(data))
        return list(map(json.dumps, data))


def _texts(values: list[str]) -> list[str]:
    whole = "".join(values)
    if len(quoted(whole)) == len(whole) + 2:  # nothing in it that is written in another way
        return [f'"{value}"' for value in values]
    return list(map(quoted, values))


@functools.cache
def _form(cls: type[Component], name: str) -> str:
    """Return the text of components of a class, with a place for each field."""
    places = ", ".join([f'"type": {quoted(name)}', *(f"{quoted(field)}: %s" for field in cls.field_names())])
    return f"{{{places}}}"
