"""Runs the items of a study, and keeps what is complete."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

import impactlab
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.folder import plain

if TYPE_CHECKING:
    import xarray as xr

    from impactlab.folder import Folder
    from impactlab.study import Item, Study


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
    """Simulate, one after another, what is not in the folder yet; each simulation uses all workers.

    Parameters
    ----------
    items : list of Item
    folder : Folder, optional
        Where each result is kept as soon as it is there.
    workers : int, optional
        Number of threads; by default one per core.
    progress : bool
        Whether to show on stderr what is being done.

    Returns
    -------
    dict of str to Dataset
        Results by key, in the order of the items.
    """
    results: dict[str, xr.Dataset] = {}
    told: dict[tuple[type[Warning], str], list[str]] = {}
    pool = None if workers is None else ThreadPoolExecutor(workers)
    try:
        for number, (key, network, options) in enumerate(items, start=1):
            show = _reporter(f"[{number}/{len(items)}] {key}", progress)
            saved = None if folder is None else folder.load_item(items[number - 1])
            if saved is None:
                try:
                    with warnings.catch_warnings(record=True) as caught:
                        warnings.simplefilter("always")
                        saved = impactlab.simulate(network, **options, executor=pool, progress=show)
                except ImpactLabError as error:
                    raise type(error)(f"Item {key!r}: {error}") from error
                for warning in caught:
                    told.setdefault((warning.category, str(warning.message)), []).append(key)
                if folder is not None:
                    folder.save_item(items[number - 1], saved)
            results[key] = saved
    finally:
        if pool is not None:
            pool.shutdown(cancel_futures=True)
        if progress and sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    for (category, message), keys in told.items():  # once, however many items it concerns
        others = f" and {len(keys) - 1} more" if len(keys) > 1 else ""
        warnings.warn(f"Item {keys[0]!r}{others}: {message}", category, stacklevel=4)
    return results


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
