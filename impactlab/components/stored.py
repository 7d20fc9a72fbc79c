"""Networks as the text that results keep, of members that have much in common, and what to cite for them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from json.encoder import encode_basestring_ascii as quoted
from operator import attrgetter
from typing import Any, NamedTuple, Protocol

import impactlab
from impactlab.components.component import Component, classes_named, plain
from impactlab.components.evaluation import are_one
from impactlab.components.literature import parts as entries_in


class Given(Protocol):
    """A network; see `impactlab.components.composition.Composition`."""

    def given(self) -> Mapping[str, Mapping[str, Component]]: ...


class Stored(NamedTuple):
    """A network as results keep it."""

    parts: tuple[str, ...]  # of what JSON makes of `Given.to_dict`
    names: tuple[str, ...]  # of the classes of all components, as the text has them


def stored(network: Given) -> Stored:
    """Return a network as results keep it; what many members have in common is written once."""
    writer, parts = _Writer({}), list[str]()
    for title, family in network.given().items():
        parts += [f"{'}, ' if parts else '{'}{quoted(title)}: {{", *writer.members(family)]
    return Stored((*parts, "}}"), tuple(writer.names))


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


def entries(data: Any) -> list[str]:
    """Return the entries of BibTeX of impactlab and of classes that plain data or stored networks name, each once."""
    found = [f"@software{{impactlab,\n  title = {{impactlab}},\n  version = {{{impactlab.__version__}}},\n}}"]
    for name in dict.fromkeys(named_in(data)):
        module, _, last = name.rpartition(".")
        classes = [item for place, item in classes_named(last).items() if module in ("", place)]
        found += [entry for item in classes[:1] for entry in entries_in(item.citation)]
    return list(dict.fromkeys(found))


Piece = str | list[str]
"""Text shared by all members, or one text per member."""


class _Writer(NamedTuple):
    """Writes components and the values of their fields as JSON, many at a time: networks may have 100 000 of them.

    Output is a list of pieces; the pieces of a member, joined, are its text.
    """

    names: dict[str, None]  # of the classes that were written

    def members(self, family: Mapping[str, Component]) -> list[str]:
        """Return the parts of the text of members by name."""
        pieces = _merged([*_texts(list(family)), ": ", *self.values(list(family.values())), ", "])
        parts = [""] * (len(pieces) * len(family))
        for place, piece in enumerate(pieces):
            parts[place :: len(pieces)] = [piece] * len(family) if isinstance(piece, str) else piece
        if parts:
            parts[-1] = parts[-1].removesuffix(", ")
        return parts

    def values(self, values: list[Any]) -> list[Piece]:
        """Return components or values of a field; what several have in common is written once."""
        if are_one(values):
            return [_rows(self._of_kind(type(values[0]), values[:1]), 1)[0]]
        kinds = list(dict.fromkeys(map(type, values)))
        if kinds == [str]:
            return _texts(values)
        keys = list(map(id, values))
        if len(kinds) == 1 and len(set(keys)) == len(keys):
            return self._of_kind(kinds[0], values)
        distinct, known = dict(zip(keys, values, strict=True)), dict[int, str]()
        for kind in kinds:
            own = {at: value for at, value in distinct.items() if type(value) is kind}
            known.update(zip(own, _rows(self._of_kind(kind, list(own.values())), len(own)), strict=True))
        return [list(map(known.__getitem__, keys))]

    def _of_kind(self, kind: Any, values: list[Any]) -> list[Piece]:
        if issubclass(kind, Component) and kind.to_dict is Component.to_dict:
            name, pieces = kind.stored_name(), list[Piece]()
            self.names[name] = None
            for field in kind.field_names():
                pieces += [f", {quoted(field)}: ", *self.values(list(map(attrgetter(field), values)))]
            return [f'{{"type": {quoted(name)}', *pieces, "}"]
        data = [plain(value) for value in values] if kind is not float else values
        self.names.update(dict.fromkeys(named_in(data)))
        return [list(map(json.dumps, data))]


def _texts(values: list[str]) -> list[Piece]:
    whole = "".join(values)
    if len(quoted(whole)) == len(whole) + 2:  # nothing in it that is written in another way
        return ['"', values, '"']
    return [list(map(quoted, values))]


def _merged(pieces: list[Piece]) -> list[Piece]:
    """Return the pieces with neighbouring shared pieces joined."""
    result: list[Piece] = []
    for piece in pieces:
        if isinstance(piece, str) and result and isinstance(last := result[-1], str):
            result[-1] = last + piece
        else:
            result.append(piece)
    return result


def _rows(pieces: list[Piece], count: int) -> list[str]:
    """Return the texts of so many members."""
    columns = [[piece] * count if isinstance(piece, str) else piece for piece in pieces]
    return list(map("".join, zip(*columns, strict=True)))
