"""Runs the items of a study, and keeps what is complete."""

from __future__ import annotations

import sys
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import TYPE_CHECKING

import impactlab
from impactlab.errors import ImpactLabError, Interrupted, InvalidInput
from impactlab.folder import plain

if TYPE_CHECKING:
    import xarray as xr

    from impactlab.folder import Folder
    from impactlab.study import Item, Study

AT_ONCE = 2
"""Items that run at a time: what one does on a single core fills the gaps of the other."""


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
    """Simulate what is not in the folder yet, two items at a time, with threads that they share.

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
    from impactlab.ensemble import cores

    results: dict[str, xr.Dataset] = {}
    heard: dict[tuple[type[Warning], str], set[str]] = {}
    parts = dict.fromkeys((item.key for item in items), 0.0)
    running: dict[int, str] = {}  # key by thread
    stop = threading.Event()
    threads = cores() if workers is None else workers
    at_once = 1 if any("tolerance" in item.options for item in items) else min(AT_ONCE, threads)
    pool, turns = ThreadPoolExecutor(threads), ThreadPoolExecutor(at_once)

    def simulated(item: Item) -> xr.Dataset:
        def note(part: float) -> None:
            if stop.is_set():
                raise Interrupted("The study was stopped.")
            parts[item.key] = part

        note(0.0)
        running[threading.get_ident()] = item.key
        return impactlab.simulate(item.network, **item.options, executor=pool, progress=note)

    def hear(message: Warning | str, category: type[Warning], *_: object) -> None:
        heard.setdefault((category, str(message)), set()).add(running.get(threading.get_ident(), key))

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.showwarning = hear  # type: ignore[assignment]  # the rest of its arguments is not needed
            key = items[0].key if items else ""
            kept = {item.key: folder.load_item(item) for item in items} if folder is not None else {}
            futures = {item.key: turns.submit(simulated, item) for item in items if kept.get(item.key) is None}
            for number, item in enumerate(items, start=1):
                key = item.key
                show = _reporter(f"[{number}/{len(items)}] {key}", progress)
                saved = kept.get(key)
                if saved is not None:
                    results[key] = saved
                    continue
                future = futures.pop(key)
                while not wait([future], 0.1).done:
                    show(parts[key])
                try:
                    results[key] = future.result()
                except ImpactLabError as error:
                    raise type(error)(f"Item {key!r}: {error}") from error
                if folder is not None:
                    folder.save_item(item, results[key])
    finally:
        stop.set()
        for executor in (turns, pool):
            executor.shutdown(cancel_futures=True)
        if progress and sys.stderr.isatty():
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)
    for (category, message), concerned in heard.items():  # once, however many items it concerns
        first = next(item.key for item in items if item.key in concerned)
        others = f" and {len(concerned) - 1} more" if len(concerned) > 1 else ""
        warnings.warn(f"Item {first!r}{others}: {message}", category, stacklevel=4)
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
