"""The warnings of a run as a table in its dataset."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from impactlab.errors import KINDS, AccuracyWarning, ImpactLabWarning
from impactlab.results.labels import Variables
from impactlab.results.stack import Findings

TABLE, KIND = "warnings", "warning"
"""Name of the table, and of its dimension, along which kinds are."""


def by_kind(given: Iterable[ImpactLabWarning]) -> dict[str, str]:
    """Return the texts of the warnings that concern results, by kind; several of one kind are one text."""
    texts: dict[str, list[str]] = {}
    for warning in given:
        if isinstance(warning, AccuracyWarning) and str(warning) not in texts.setdefault(warning.kind, []):
            texts[warning.kind].append(str(warning))
    return {kind: " ".join(texts[kind]) for kind in KINDS if kind in texts}


def with_warnings(found: Findings, given: Mapping[str, str]) -> Findings:
    """Add a table of warnings, texts by kind, if there are any."""
    if not given:
        return found
    table, labels = _table(given)
    return found._replace(variables={**found.variables, **table}, coordinates={**found.coordinates, **labels})


def with_all_kinds(results: Sequence[Findings]) -> list[Findings]:
    """Let the tables of some runs have the kinds of all of them, with an empty text where a run has none."""
    tables = [_texts(found) for found in results]
    kinds = [kind for kind in KINDS if any(kind in table for table in tables)]
    return [
        with_warnings(found, {kind: table.get(kind, "") for kind in kinds}) if found.variables else found
        for found, table in zip(results, tables, strict=True)
    ]


def _table(given: Mapping[str, str]) -> tuple[Variables, Variables]:
    attrs = {"long_name": "warnings of the run, by kind", "comment": "empty where none was given"}
    kinds: Any = np.array(list(given)), np.array(list(given.values()))
    return {TABLE: ((KIND,), kinds[1], attrs)}, {KIND: ((KIND,), kinds[0], {"long_name": "kind of warning"})}


def _texts(found: Findings) -> dict[str, str]:
    """Return the texts in the table of a run, by kind."""
    if TABLE not in found.variables:
        return {}
    kinds, texts = (np.asarray(item[1]).tolist() for item in (found.coordinates[KIND], found.variables[TABLE]))
    return dict(zip(kinds, texts, strict=True))
