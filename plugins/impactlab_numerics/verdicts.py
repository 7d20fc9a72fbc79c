"""Claims of the studies, and what becomes of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import xarray as xr

from impactlab.studies import Check


class Claim(NamedTuple):
    """A statement with what was measured and the verdict."""

    section: str
    statement: str
    measured: str
    verdict: str


def verdict_of(holds: bool, tested: bool = True) -> str:
    """Return the verdict on a statement."""
    return ("holds" if holds else "does not hold") if tested else "not testable"


def table_of(claims: Sequence[Any]) -> xr.Dataset:
    """Return claims, all of one kind of named tuple, as a table."""
    columns = {name: [getattr(claim, name) for claim in claims] for name in claims[0]._fields}
    return xr.Dataset({name: ("claim", values) for name, values in columns.items()})


def checks_of(table: xr.Dataset) -> list[Check]:
    """Return a check for each claim of a table: that it was not found to be wrong."""
    rows = zip(table.statement.values, table.verdict.values, table.measured.values, strict=True)
    return [Check(str(name), verdict != "does not hold", str(found)) for name, verdict, found in rows]
