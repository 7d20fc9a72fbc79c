"""Runs the items of a study, and keeps completed ones."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import impactlab
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.progress import Report, is_watched, nothing
from impactlab.results.measured import headline
from impactlab.results.plain_values import plain_data
from impactlab.studies.study import Item, SweepItem

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import xarray as xr

    from impactlab.studies.run_folder import Folder
    from impactlab.studies.study import Study
    from impactlab.sweeps.product import Sweep
    from impactlab.sweeps.scheduler import Job


class Simulations(NamedTuple):
    """Items of a study, and the sweeps to which points among them belong, by key."""

    items: list[Item]
    sweeps: dict[str, Sweep]


def simulations(study: Study) -> Simulations:
    """Return the items of a study, each point of a sweep as one.

    Items of the same key, options that are not plain data, and points without a network are refused.
    """
    found: list[Item] = []
    sweeps: dict[str, Sweep] = {}
    keys = []
    for entry in study.items():
        keys.append(entry.key)
        if not isinstance(entry, SweepItem):
            found.append(entry)
            continue
        from impactlab.sweeps.product import make_sweep  # what is only described needs nothing that simulates

        sweeps[entry.key] = sweep = make_sweep(entry.make_network, entry.over, **entry.options)
        for point in sweep.points:
            key = f"{entry.key}, {point.key}"
            if point.network is None:
                raise InvalidInput(f"Item {key!r}: {point.refusal}")
            keys.append(key)
            found.append(Item(key, point.network, point.options))
    folded = [key.casefold() for key in keys]  # they are names of files
    for key in keys:
        if folded.count(key.casefold()) > 1:
            raise InvalidInput(f"The study {study.name!r} has two items with the key {key!r}.")
    for item in found:
        plain_data(item.options)
    return Simulations(found, sweeps)


def checked_workers(workers: int | None) -> None:
    """Refuse a number of threads that is not a whole number of at least 1, or None."""
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise InvalidInput(f"workers must be a whole number of at least 1, not {workers!r}.")


def run_simulations(
    wanted: Simulations, folder: Folder | None, workers: int | None, executor: Executor | None, progress: bool
) -> dict[str, xr.Dataset]:
    """Simulate the items that the folder does not hold, several at a time, on shared threads; return all by key.

    A folder keeps each result as soon as it and all before it are there. An item with a tolerance may spend a time on
    it: then each has the cores for itself.
    """
    from impactlab.compiling.announced import announced
    from impactlab.sweeps.scheduler import run_together

    items = wanted.items
    by_key = {item.key: item for item in items}
    numbers = {key: number for number, key in enumerate(by_key, start=1)}
    kept = {key: folder.load_item(item) for key, item in by_key.items()} if folder is not None else {}
    results = {key: result for key, result in kept.items() if result is not None}
    begun: set[str] = set()
    latest: dict[str, Callable[[], str]] = {}

    def job(item: Item) -> Job:
        def run(pool: Executor, note: Callable[[float], None]) -> xr.Dataset:
            def told(part: float, found: Callable[[], str]) -> None:
                latest[item.key] = found
                note(part)

            return impactlab.simulate(
                item.network,
                **item.options,
                executor=pool,
                progress=Report(told),
                checkpoint=None if folder is None else folder.part(item),  # type: ignore[arg-type]
            )

        return run

    def finished(key: str, outcome: xr.Dataset | ImpactLabError) -> None:
        if isinstance(outcome, ImpactLabError):
            raise type(outcome)(f"Item {key!r}: {outcome}") from outcome
        results[key] = outcome
        if progress:
            _transient("")
            print(f"[{numbers[key]}/{len(items)}] {key}: {headline(outcome)}", file=sys.stderr, flush=True)
        if folder is not None:
            folder.save_item(by_key[key], outcome)

    def watch(key: str, parts: Mapping[str, float]) -> None:
        if not progress:
            return
        if key not in begun and not is_watched():
            print(f"[{numbers[key]}/{len(items)}] {key}", file=sys.stderr, flush=True)
        begun.add(key)
        found = latest.get(key, nothing)()
        _transient(f"[{numbers[key]}/{len(items)}] {key} {100.0 * parts[key]:.0f} %{found and f': {found}'}")

    jobs = {key: job(item) for key, item in by_key.items() if key not in results}
    alone = any("tolerance" in item.options for item in items)
    try:
        with announced(progress):
            run_together(jobs, finished, kind="Item", executor=executor, workers=workers, alone=alone, watch=watch)
    finally:
        if progress:
            _transient("")
    ordered = {item.key: results[item.key] for item in items}
    for key, sweep in wanted.sweeps.items():
        ordered[key] = sweep.dataset({point.key: ordered.pop(f"{key}, {point.key}") for point in sweep.points})
    return ordered


def _transient(text: str) -> None:
    """Write a line in the place of the last one, where somebody watches."""
    if not is_watched():
        return
    line = f"\r\x1b[K{text[: shutil.get_terminal_size().columns - 1]}" if sys.stderr.isatty() else f"\r{text:<100.100}"
    print(line, end="", file=sys.stderr, flush=True)
