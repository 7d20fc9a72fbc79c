"""Points of a sweep that are kept in the folder of a checkpoint as they end."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from typing import Any

import impactlab.errors
from impactlab.errors import Diverged, ImpactLabWarning, give, heard_by, noted
from impactlab.results.checkpoint import Checkpoint
from impactlab.results.plain_values import digest
from impactlab.results.stack import Findings
from impactlab.sweeps.product import Outcome, found_of
from impactlab.sweeps.scheduler import Heard, Job
from impactlab.sweeps.sweep_points import Point

AT_FIRST, MOST_GROWTH = 64, 4
"""Points that run beside each other and are kept as one item, at first, and how much more they may become at once."""

ITEM_SECONDS = 4.0
"""Time that such an item should take (s)."""


class KeptPoints:
    """Points of a sweep that are kept: those that ran beside others as one item, the others each as one.

    Parameters
    ----------
    checkpoint : Checkpoint
    heard : Heard
        Takes the warnings of points that are kept.
    """

    def __init__(self, checkpoint: Checkpoint, heard: Heard) -> None:
        self.checkpoint, self.heard = checkpoint, heard
        self.number = AT_FIRST
        """How many points are to run beside each other next."""
        self.begun = time.monotonic()

    def load(self, points: Sequence[Point]) -> dict[str, Outcome]:
        """Return the outcomes of points that are kept."""
        known = {point.key for point in points}
        found: dict[str, Outcome] = {}
        for path in self.checkpoint.paths("points"):
            for key, findings, warnings in self.checkpoint.item(path.stem).load() or ():
                if key in known:
                    found[key] = Findings(*findings)
                    with heard_by(self.heard.of(key)):
                        _give(warnings)
        self.begun = time.monotonic()
        return found

    def beside(self) -> Checkpoint:
        """Return the checkpoint of points that run beside each other next, until they are kept."""
        return self.checkpoint.part("beside")

    def save(self, outcomes: dict[str, Outcome]) -> None:
        """Keep points that ran beside others; those that were refused are refused again at once."""
        rows = [
            (key, tuple(found_of(found)), _told(self.heard.of_job(key)))
            for key, found in outcomes.items()
            if not isinstance(found, Exception)
        ]
        if rows:
            self.checkpoint.item(f"points-{digest([key for key, *_ in rows])}").save(rows)
        self.beside().clear()
        now = time.monotonic()
        wanted = self.number * ITEM_SECONDS / max(now - self.begun, 1e-9)
        self.number, self.begun = max(AT_FIRST, min(int(wanted), MOST_GROWTH * self.number)), now

    def clear_parts(self, outcomes: Mapping[str, Outcome]) -> None:
        """Remove what was kept within points that have come to their ends in another way."""
        for key, outcome in outcomes.items():
            if not isinstance(outcome, Exception):
                shutil.rmtree(self.checkpoint.path / _name(key), ignore_errors=True)

    def kept(self, key: str, job: Callable[[Checkpoint], Job]) -> Job:
        """Return a job whose outcome is kept, or that returns the one that is; it has a checkpoint until then."""
        name = _name(key)
        item = self.checkpoint.item(name)

        def run(pool: Executor, note: Callable[[float], None]) -> Any:
            outcome: Any
            if (kept := item.load()) is not None:
                findings, error, warnings = kept
                _give(warnings)
                if error is not None:
                    raise Diverged(error)
                return Findings(*findings)
            inside = self.checkpoint.part(name)
            with noted() as warnings:
                try:
                    outcome, error = job(inside)(pool, note), None
                except Diverged as diverged:
                    outcome, error = None, str(diverged)
            findings = None if outcome is None else tuple(found_of(outcome))
            item.save((findings, error, _told(warnings)))
            inside.clear()
            if error is not None:
                raise Diverged(error)
            return outcome

        return run


def _name(key: str) -> str:
    return f"point-{digest(key)}"


def _told(warnings: Sequence[ImpactLabWarning]) -> list[tuple[str, str, str]]:
    """Return warnings as plain data."""
    return [(type(warning).__name__, str(warning), warning.kind) for warning in warnings]


def _give(told: Sequence[tuple[str, str, str]]) -> None:
    """Give warnings again."""
    for category, text, kind in told:
        give(getattr(impactlab.errors, category)(text, kind))
