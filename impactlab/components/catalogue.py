"""What networks are made of as a table: bodies, contacts, laws and loads, and functions that make some."""

from __future__ import annotations

import dataclasses
import html
import inspect
import re
from collections.abc import Iterator
from typing import Any, NamedTuple

import impactlab
from impactlab.components.coherent import SharedCosines
from impactlab.components.coloured import FilteredNoise
from impactlab.components.composition import FAMILIES as MEMBERS
from impactlab.components.contact import Contact, ContactLaw, RoundContact
from impactlab.components.coupling import Coupling, CouplingLaw
from impactlab.components.excitation import Excitation
from impactlab.components.fields import declared_by
from impactlab.components.literature import in_one_line, parts
from impactlab.components.oscillator import Oscillator
from impactlab.components.sides import Combination
from impactlab.components.structure import Structure
from impactlab.components.textbooks import SOURCES
from impactlab.errors import InvalidInput
from impactlab.inputs import checked, suggestion

FAMILIES: dict[str, Any] = {
    "bodies": MEMBERS["oscillators"],
    "contacts and couplings": (Contact, RoundContact, Coupling, Combination),
    "contact laws": (ContactLaw,),
    "coupling laws": (CouplingLaw,),
    "excitations": MEMBERS["excitations"],
}
"""Base classes of each family, or classes."""

FUNCTIONS = {
    "bodies": ("LinearOscillator.massless", "beam"),
    "contacts and couplings": ("backlash",),
    "excitations": ("coherent", "correlated", "davenport", "harichandran_vanmarcke"),
}
"""Functions that return what belongs to a family."""

LEFT_OUT = Oscillator, Structure, ContactLaw, CouplingLaw, Excitation, FilteredNoise, SharedCosines
"""Classes that are abstract, or made by functions."""

_UNITS = re.compile(r"\(((?:k?g|m|s|N2?|J|F|rad|ohm)\b[^(),;]*)[^()]*\)")
"""Units in the description of a parameter."""


class Entry(NamedTuple):
    """A part of networks, or a function that makes some."""

    family: str
    name: str
    description: str  # with its formula
    parameters: tuple[str, ...]  # with units and defaults
    source: str  # publication


class Catalogue(tuple[Entry, ...]):
    """Parts of networks; prints as a table, and is one in notebooks."""

    def __str__(self) -> str:
        lines: list[str] = []
        for family in dict.fromkeys(entry.family for entry in self):
            lines.append(family)
            for entry in (entry for entry in self if entry.family == family):
                lines.append(f"  {entry.name}({', '.join(entry.parameters)})")
                lines.extend(f"      {text}" for text in (entry.description, entry.source) if text)
        return "\n".join(lines)

    __repr__ = __str__

    def _repr_html_(self) -> str:
        rows = [Entry._fields, *((*entry[:3], ", ".join(entry.parameters), entry.source) for entry in self)]
        return (
            "<table>"
            + "".join(
                f"<tr>{''.join(f'<{cell}>{html.escape(text)}</{cell}>' for text in row)}</tr>"
                for cell, row in zip(["th", *["td"] * len(self)], rows, strict=True)
            )
            + "</table>"
        )


@checked
def catalogue(family: str | None = None) -> Catalogue:
    """Return what networks are made of: formula, parameters with units, and source.

    Parameters
    ----------
    family : str, optional
        "bodies", "contacts and couplings", "contact laws", "coupling laws" or "excitations"; all by default.

    Returns
    -------
    Catalogue
        A tuple of entries with the fields `family`, `name`, `description`, `parameters` and `source`.

    Raises
    ------
    InvalidInput
        If there is no such family.

    Examples
    --------
    >>> table = il.catalogue("contact laws")
    >>> "HertzContact" in str(table)
    True
    """
    if family is not None and family not in FAMILIES:
        raise InvalidInput(f"catalogue: {suggestion(family, FAMILIES)}")
    found = [entry for name in FAMILIES if family in (None, name) for entry in _entries(name)]
    return Catalogue(found)


def _entries(family: str) -> Iterator[Entry]:
    for name in sorted(dir(impactlab)):
        cls = getattr(impactlab, name) if name[0].isupper() else None
        if inspect.isclass(cls) and issubclass(cls, FAMILIES[family]) and cls not in LEFT_OUT:
            yield _entry(family, name, cls, _fields(cls) if cls is not Combination else _arguments(cls))
    for name in FUNCTIONS.get(family, ()):
        function: Any = impactlab
        for part in name.split("."):
            function = getattr(function, part)
        yield _entry(family, name, function, _arguments(function))


def _entry(family: str, name: str, item: Any, parameters: Iterator[str]) -> Entry:
    summary = str(inspect.getdoc(item)).split("\n\n")[0].replace("\n", " ").replace("``", "").replace("`", "")
    source = in_one_line(parts(getattr(item, "citation", "") or SOURCES.get(name, "")))
    return Entry(family, name, summary, tuple(parameters), source)


def _arguments(function: Any) -> Iterator[str]:
    """Give the parameters of a function, with units as its docstring has them."""
    text = str(inspect.getdoc(function))
    for name, given in inspect.signature(function).parameters.items():
        described = re.search(
            rf"^(?:\w+, )*{name}(?:, \w+)* : (?!callable).*\n((?: {{4}}.*\n)+)", text + "\n", re.MULTILINE
        )
        units = _UNITS.search(described[1]) if described else None
        unit = f" [{units[1]}]" if units else ""
        yield name + unit + ("" if given.default is given.empty else f" = {given.default!r}")


def _fields(cls: Any) -> Iterator[str]:
    """Give the fields of a component, but for states."""
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    for declared in (declared for declared in declared_by(cls) if not declared.state):
        unit = "" if declared.units == "1" else f" [{declared.units}]"
        yield declared.name + unit + ("" if declared.needed else f" = {defaults[declared.name]!r}")
