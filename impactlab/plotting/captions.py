"""What is written in drawings of networks: components and their numbers as lines of text."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable
from typing import Any

from impactlab.components.component import Component
from impactlab.components.excitation import Excitation
from impactlab.components.sides import WALL, Combination, Side
from impactlab.components.structure import Structure
from impactlab.plotting.style import name_text, number_text, units_text

FIELDS = 3
"""Numbers of a component that are written."""

_WIDE = 22


_PERSONS = {
    "Bouc", "Wen", "Braun", "Walton", "Carvalho", "Martins", "Clough", "Penzien", "Coulomb", "Crossley", "Hunt",
    "Kanai", "Tajimi", "Kelvin", "Voigt", "Lankarani", "Nikravesh", "Ornstein", "Uhlenbeck",
}  # fmt: skip
"""Persons in names of classes, of whom two stand side by side or who do not come first."""


def words(component: Component) -> str:
    """Return the name of a class as words, such as ``Bouc–Wen coupling``."""
    first, *others = re.split(r"(?<=[a-z0-9])(?=[A-Z])", type(component).__name__)
    text, before = first.capitalize(), first
    for word in others:
        persons = word in _PERSONS and before in _PERSONS
        text += f"\N{EN DASH}{word}" if persons else f" {word if word in _PERSONS else word.lower()}"
        before = word
    return text


def numbers(component: Component, without: Iterable[str] = ()) -> list[str]:
    """Return the fields of a component that are numbers other than 0, as text with units."""
    lines = []
    for name in component.field_names():
        value = getattr(component, name)
        if name not in without and isinstance(value, float | int) and not isinstance(value, bool) and value:
            lines.append(f"{name.replace('_', ' ')} = {with_units(value, component.units_of(name))}")
    return [*lines[:FIELDS], "…"] if len(lines) > FIELDS else lines


def with_units(value: float, units: str) -> str:
    """Return a number with its units."""
    return number_text(value) if units == "1" else f"{number_text(value)} {units_text(units)}"


def law_lines(name: str, law: Component) -> list[str]:
    """Return the lines that describe a law; of a single number the units tell what it is. A name comes first."""
    fields = numbers(law, law.state_names())
    if len(fields) == 1 and " " in fields[0].split(" = ")[1]:
        fields = [fields[0].split(" = ")[1]]
    return [*([name_text(name)] if name else []), *textwrap.wrap(words(law), _WIDE), *fields]


def excitation_lines(excitation: Excitation) -> list[str]:
    """Return the lines that describe an excitation."""
    density = getattr(excitation, "spectral_density", None)
    if not isinstance(density, float):
        return [*textwrap.wrap(words(excitation), _WIDE), *numbers(excitation)[:2]]
    units = excitation.units_of("spectral_density")
    return [*textwrap.wrap(words(excitation), _WIDE), f"$S$ = {with_units(density, units)}"]


def structure_lines(structure: Structure) -> list[str]:
    """Return the lines that describe a structure: its number of coordinates or modes."""
    count, named = len(structure.bodies()), len(structure.weights())
    modal = named or not any(structure.terms())
    lines = [f"{count} {'mode' if modal else 'coordinate'}{'s' if count > 1 else ''}"]
    if modal:
        bodies = [math.sqrt(body["stiffness"] / body["mass"]) for body in structure.bodies().values()]
        ends = dict.fromkeys(number_text(item) for item in (min(bodies), max(bodies)))
        lines.append(f"{' to '.join(ends)} {units_text('rad s-1')}")
    return lines


def side_text(side: Side | tuple[Side, Side]) -> str:
    """Return the name of a side of a contact or a coupling, a combination as a sum, and x and y of a round contact."""
    if isinstance(side, tuple):
        return f"({', '.join(map(side_text, side))})"
    if side is WALL:
        return "the wall"
    if not isinstance(side, Combination):
        return str(side)
    parts = []
    for body, weight in side.weights:
        sign = "\N{MINUS SIGN}" if weight < 0.0 else "+"
        size = "" if abs(weight) == 1.0 else f"{number_text(abs(weight))} "
        parts.append(f"{sign} {size}{body}")
    return " ".join(parts).removeprefix("+ ")


def widest(lines: Iterable[str]) -> int:
    """Return the number of letters of the longest line, without the signs of formulas."""
    return max((len(re.sub(r"\\times|[$^{}\\]", "", line)) for line in lines), default=0)


def plain_text(text: Any) -> str:
    """Return text without the signs of formulas, for where these are not drawn."""
    powers = str.maketrans("0123456789-/", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻ᐟ")
    shown = str(text).replace(r" \times ", " × ")
    return re.sub(r"\^\{(.*?)\}", lambda found: found[1].translate(powers), shown.replace("$", ""))
