"""The laws and loads of the package as a table."""

from __future__ import annotations

import dataclasses
import html
import inspect
from collections.abc import Iterator
from typing import Any, NamedTuple

import impactlab
from impactlab.components.coloured import FilteredNoise
from impactlab.components.component import suggestion
from impactlab.components.contact import ContactLaw
from impactlab.components.coupling import CouplingLaw
from impactlab.components.excitation import BaseMotion, Excitation, Source
from impactlab.components.fields import declared_by
from impactlab.components.literature import in_one_line, parts
from impactlab.components.oscillator import Oscillator
from impactlab.components.prescribed import PrescribedMotion
from impactlab.components.structure import Structure
from impactlab.errors import InvalidInput

FAMILIES: dict[str, Any] = {
    "bodies": (Oscillator, Structure, PrescribedMotion),
    "contact laws": (ContactLaw,),
    "couplings": (CouplingLaw,),
    "excitations": (Excitation, Source, BaseMotion),
}
"""Base classes of each family, or classes."""

ABSTRACT = Oscillator, Structure, ContactLaw, CouplingLaw, Excitation, FilteredNoise


class Entry(NamedTuple):
    """A law or load."""

    family: str
    name: str
    description: str  # with its formula
    parameters: tuple[str, ...]  # with units and defaults
    source: str  # publication


class Catalogue(tuple[Entry, ...]):
    """Laws and loads; prints as a table, and is one in notebooks."""

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


def catalogue(family: str | None = None) -> Catalogue:
    """Return the laws and loads of the package: formula, parameters with units, and source.

    Parameters
    ----------
    family : str, optional
        "bodies", "contact laws", "couplings" or "excitations"; all by default.

    Returns
    -------
    Catalogue
        A tuple of entries with the fields `family`, `name`, `description`, `parameters` and `source`.

    Raises
    ------
    InvalidInput
        If there is no such family.
    """
    if family is not None and family not in FAMILIES:
        raise InvalidInput(f"catalogue: {suggestion(family, FAMILIES)}")
    found = [entry for name in FAMILIES if family in (None, name) for entry in _entries(name)]
    return Catalogue(found)


def _entries(family: str) -> Iterator[Entry]:
    for name in sorted(dir(impactlab)):
        cls = getattr(impactlab, name) if name[0].isupper() else None
        if inspect.isclass(cls) and issubclass(cls, FAMILIES[family]) and cls not in ABSTRACT:
            summary = str(inspect.getdoc(cls)).split("\n\n")[0].replace("\n", " ").replace("``", "").replace("`", "")
            source = in_one_line(parts(getattr(cls, "citation", "")))
            yield Entry(family, name, summary, tuple(_parameters(cls)), source)


def _parameters(cls: Any) -> Iterator[str]:
    defaults = {field.name: field.default for field in dataclasses.fields(cls)}
    for declared in (declared for declared in declared_by(cls) if not declared.state):
        unit = "" if declared.units == "1" else f" [{declared.units}]"
        yield declared.name + unit + ("" if declared.needed else f" = {defaults[declared.name]!r}")
