"""Networks as files that people write and read: TOML, with units beside the numbers.

What is wrong in a file is told with its line.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from impactlab.components.component import Component
from impactlab.components.composition import FAMILIES, Composition, kind_of
from impactlab.errors import InvalidInput
from impactlab.given_files import text_in
from impactlab.toml_text import key_text, lines_of, parsed_toml, value_text

SIMULATE = "simulate"
"""Table of a file with the options of a simulation."""

KeyPath = tuple[str, ...]
"""Keys from that of a table to the one that is meant."""


class NetworkFile(NamedTuple):
    """The text of a network's file, and what it says."""

    place: str
    text: str
    data: dict[str, Any]

    @classmethod
    def read(cls, source: str | os.PathLike[str]) -> NetworkFile:
        """Read a file, or a text of more than one line."""
        if isinstance(source, str) and "\n" in source:
            place, text = "The text", source
        else:
            place, text = str(source), text_in(source)
        return cls(place, text, parsed_toml(text, place))

    @property
    def options(self) -> dict[str, Any]:
        """The options of a simulation that the file has."""
        options = self.data.get(SIMULATE, {})
        if not isinstance(options, dict):
            raise self.refusal((SIMULATE,), f"{SIMULATE} must be a table, not {options!r}.")
        return options

    def network(self, kind: type[Composition]) -> Any:
        """Return the network, of that class; refuse one that cannot be made with the line that is wrong."""
        data = {name: family for name, family in self.data.items() if name != SIMULATE}
        try:
            return kind.from_dict({"oscillators": {}, **data})
        except InvalidInput as error:
            path, message = _wrong(data, str(error))
            raise self.refusal(path, message) from error

    def refusal(self, path: KeyPath, message: str) -> InvalidInput:
        """Return an error with the place of a key, or of the nearest table around it that has a line of its own."""
        lines = lines_of(self.text)
        known = [path[:end] for end in range(len(path), 0, -1) if path[:end] in lines]
        known += [below for below in lines if path and below[: len(path)] == path]  # a table that has only tables
        where = f", line {lines[known[0]]}, {'.'.join(map(key_text, path))}" if known else ""
        return InvalidInput(f"{self.place}{where}: {message}")


def text_of(network: Composition) -> str:
    """Return a network as TOML."""
    lines: list[str] = []
    for title, members in network.given().items():
        for name, member in members.items():
            lines += _table((title, name), member)
    return "\n".join(lines)


def _table(path: KeyPath, component: Component) -> list[str]:
    """Return the lines of a component, and then of the components that are its fields."""
    lines, below = [f"[{'.'.join(map(key_text, path))}]"], []
    for key, value in component.to_dict().items():
        field = getattr(component, key, None)
        if isinstance(field, Component):
            below += _table((*path, key), field)
        elif value is not None:
            units = "1" if key == "type" else component.units_of(key)
            lines.append(f"{key} = {value_text(value)}{'' if units == '1' else f'  # {units}'}")
    return [*lines, "", *below]


def _wrong(data: Mapping[str, Any], message: str) -> tuple[KeyPath, str]:
    """Return the path to what is wrong in the data of a network, and what is said of it.

    Members are looked at one by one; else it is what the message names: a member, and what stands in it.
    """
    for title, family in data.items():
        if title not in FAMILIES or not isinstance(family, Mapping):
            return (title,), message
        for name, item in family.items():
            if isinstance(item, Mapping) and (
                found := _wrong_part((title, name), kind_of(item, FAMILIES[title]), item)
            ):
                return found
    quoted = re.findall(r"'([^']*)'", message)
    for name in quoted:
        for title, family in reversed(list(data.items())):  # a body has the name of its excitation
            if name in family:
                return (title, name, *_named_in(family[name], quoted)), message
    return (), message


def _wrong_part(path: KeyPath, kind: type[Component], item: Mapping[str, Any]) -> tuple[KeyPath, str] | None:
    """Return the path to what is wrong in a member and what is said of it, nothing if it can be made."""
    for key, value in item.items():
        if isinstance(value, Mapping) and "type" in value and (found := _wrong_part((*path, key), Component, value)):
            return found
    try:
        kind.from_dict(item)
    except InvalidInput as error:
        message = str(error)
        places = {key: re.search(rf"(?<!\w){re.escape(key)}(?!\w)", message) for key in item}
        named = {key: place.start() for key, place in places.items() if place}
        if named:
            return (*path, min(named, key=lambda key: named[key])), message
        return (*path, *_named_in(item, re.findall(r"'([^']*)'", message))), message
    return None


def _named_in(item: Any, names: Iterable[str]) -> KeyPath:
    """Return the way to the first key or value in a mapping that is one of some names, nothing if there is none."""
    for key, value in item.items() if isinstance(item, Mapping) else ():
        if key in names or (isinstance(value, str) and value in names):
            return (key,)
        if below := _named_in(value, names):
            return key, *below
    return ()
