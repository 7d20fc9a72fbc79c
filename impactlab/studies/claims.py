"""Claims of a study: statements with measurements and verdicts."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import xarray as xr

VERDICTS = ("holds", "holds partly", "does not hold", "sampling error", "not testable")
"""Verdicts on a claim."""

_TEXTS = {
    "section": "part of the study, or section of the paper, that the claim belongs to",
    "statement": "what is claimed",
    "measured": "what the study finds",
    "verdict": "verdict",
    "criterion": "when the claim holds",
    "figure": "name of the figure that shows it",
}


class Claim(NamedTuple):
    """A statement with its measurement and verdict; a criterion where it is not obvious, the figure that shows it."""

    section: str
    statement: str
    measured: str
    verdict: str
    criterion: str = ""
    figure: str = ""


class Check(NamedTuple):
    """One pass or fail of a study."""

    name: str
    ok: bool
    detail: str


def shown_in(figure: str, claims: Iterable[Claim]) -> Iterator[Claim]:
    """Give claims with the name of the figure that shows them."""
    return (claim._replace(figure=figure) for claim in claims)


def verdict_of(holds: bool, tested: bool = True) -> str:
    """Return the verdict on a statement."""
    return ("holds" if holds else "does not hold") if tested else "not testable"


def verdict_on(value: float, limits: tuple[float, float], chance: float) -> str:
    """Return the verdict on a number that should lie within limits; chance may take it a little beyond."""
    outside = max(limits[0] - value, value - limits[1], 0.0)
    return "holds" if outside == 0.0 else "sampling error" if outside <= chance else "does not hold"


def worst_verdict(verdicts: Iterable[str]) -> str:
    """Return the worst of several verdicts, "not testable" if there are none."""
    order = ("does not hold", "sampling error", "holds partly", "holds", "not testable")
    return min(verdicts, key=order.index, default="not testable")


def table_of(claims: Iterable[Claim]) -> xr.Dataset:
    """Return claims as the table that :meth:`Study.claims` returns, without empty columns."""
    import xarray as xr

    rows = list(claims)
    columns = {name: [getattr(row, name) for row in rows] for name in Claim._fields}
    for optional in ("criterion", "figure"):
        if not any(columns[optional]):
            del columns[optional]
    return xr.Dataset({name: ("claim", texts, {"long_name": _TEXTS[name]}) for name, texts in columns.items()})


def checks_of(table: xr.Dataset) -> list[Check]:
    """Return a check for each claim of a table: that it was not found to be wrong."""
    if "claim" not in table.dims:
        return []
    rows = zip(table.statement.values, table.verdict.values, table.measured.values, strict=True)
    return [Check(str(name), verdict != "does not hold", str(found)) for name, verdict, found in rows]
