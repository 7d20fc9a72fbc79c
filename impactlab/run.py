"""Runs the items of a study, and keeps what is complete."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import impactlab
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.folder import plain

if TYPE_CHECKING:
    import xarray as xr

    from impactlab.folder import Folder
    from impactlab.study import Item, Study
    from impactlab.together import Job


def checked_items(study: Study) -> list[Item]:
    """Return the items of a study.

    Raises
    ------
    InvalidInput
        If two have the same key, or an option is not plain data.
    """
    items = list(study.items())
    keys = [item.key.casefold() for item in items]  # they are names of files
    for item, key in zip(items, keys, strict=True):
        if keys.count(key) > 1:
            raise InvalidInput(f"The study {study.name!r} has two items with the key {item.key!r}.")
        plain(item.options)
    return items


def checked_workers(workers: int | None) -> None:
    """Refuse a number of threads that is not a whole number of at least 1, or None."""
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise InvalidInput(f"workers must be a whole number of at least 1, {workers!r} was given.")


def run_items(items: list[Item], folder: Folder | None, workers: int | None, progress: bool) -> dict[str, xr.Dataset]:
    """Simulate what is not in the folder yet, several items at a time, on threads that they share.

    An item with a tolerance may spend a time on it: then each has the cores for itself.

    Parameters
    ----------
    items : list of Item
    folder : Folder, optional
        Where each result is kept as soon as it and all before it are there.
    workers : int, optional
        Number of threads; by default one per core.
    progress : bool
        Whether to show on stderr what is being done.

    Returns
    -------
    dict of str to Dataset
        Results by key, in the order of the items.
    """
    from impactlab.together import run_together

    by_key = {item.key: item for item in items}
    numbers = {key: number for number, key in enumerate(by_key, start=1)}
    kept = {key: folder.load_item(item) for key, item in by_key.items()} if folder is not None else {}
    results = {key: result for key, result in kept.items() if result is not None}
    shown: dict[str, Callable[[float], None]] = {}

    def job(item: Item) -> Job:
        return lambda pool, note: impactlab.simulate(item.network, **item.options, executor=pool, progress=note)

    def finished(key: str, outcome: xr.Dataset | ImpactLabError) -> None:
        if isinstance(outcome, ImpactLabError):
            raise type(outcome)(f"Item {key!r}: {outcome}") from outcome
        results[key] = outcome
        if folder is not None:
            folder.save_item(by_key[key], outcome)

    def watch(key: str, parts: Mapping[str, float]) -> None:
        if key not in shown:
            shown[key] = _reporter(f"[{numbers[key]}/{len(items)}] {key}", progress)
        shown[key](parts[key])

    jobs = {key: job(item) for key, item in by_key.items() if key not in results}
    alone = any("tolerance" in item.options for item in items)
    try:
        run_together(jobs, finished, kind="Item", workers=workers, alone=alone, watch=watch)
    finally:
        if progress and sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    return {key: results[key] for key in by_key}


def _reporter(text: str, progress: bool) -> Callable[[float], None]:
    """Show an item on stderr and return what shows how much of it is done, on a terminal."""
    if not progress:
        return lambda _: None
    if not sys.stderr.isatty():
        print(text, file=sys.stderr, flush=True)
        return lambda _: None

    def show(part: float) -> None:
        print(f"\r\x1b[K{text} {100.0 * part:.0f} %", end="", file=sys.stderr, flush=True)

    show(0.0)
    return show
