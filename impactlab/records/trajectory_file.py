"""Trajectories written to a netCDF file while the simulation runs, in constant memory."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from impactlab.errors import Interrupted, InvalidInput
from impactlab.machine import tuning
from impactlab.plan.plan import Plan
from impactlab.records.record import Keeper
from impactlab.records.recorded_run import RecordedRun
from impactlab.records.trajectory import Sampler, Trajectory, sample_count, trajectory_of, trajectory_size
from impactlab.results.dataset import LOCK, told
from impactlab.results.labels import Variables
from impactlab.results.schema import CONTACT
from impactlab.results.snapshot import REALIZATION


@contextlib.contextmanager
def written(plan: Plan, path: Path, folder: Path) -> Iterator[Plan]:
    """Give the plan whose trajectories go to a new file instead of memory; messages say that it is in the `folder`.

    A run for which the disk has not enough space is refused.
    """
    size, free = trajectory_size(plan), shutil.disk_usage(folder).free
    found = trajectory_of(plan)
    assert found is not None
    if size > free:
        raise InvalidInput(
            f"The trajectories would take up to {size / 1e9:.3g} GB, but only {free / 1e9:.3g} GB are free in "
            f"{folder}: use a longer interval or fewer realizations."
        )
    file = _File(found[0], plan, path)
    try:
        records = tuple(
            (Streamed(file) if isinstance(item, Trajectory) else item, ratio) for item, ratio in plan.observed.records
        )
        yield replace(plan, observed=replace(plan.observed, records=records))
    finally:
        file.close()


def lose_paths(plan: Plan) -> None:
    """Fill the paths of realizations that diverged with NaN in the file of a plan."""
    lost = np.setdiff1d(np.arange(plan.realizations.number), plan.realizations.finite_places)
    for record, _ in plan.observed.records:
        if isinstance(record, Streamed):
            record.file.lose(lost)


class _File:
    """The file and its variables. What goes wrong while it is written is said in the words of impactlab."""

    def __init__(self, record: Trajectory, plan: Plan, path: Path) -> None:
        import netCDF4

        self.record, self.plan, self.path, self.closed = record, plan, path, False
        self.kept = record.kept(plan.snapshot)
        samples = sample_count(plan)
        chunk, numbers = tuning().chunk_bytes, sum(len(item.names) for item in self.kept)
        self.length = max(1, min(samples, chunk // (8 * plan.realizations.lanes * numbers)))
        with LOCK, self.said():
            self.data = netCDF4.Dataset(os.fspath(path), "w", format="NETCDF4")
            self.data.set_fill_off()  # everything is written
            sizes = {"realization": plan.realizations.number, "time": samples}
            sizes |= {item.dimension: len(item.names) for item in self.kept}
            for name, count in sizes.items():
                self.data.createDimension(name, count)
            for item in self.kept:
                count = len(item.names)
                lanes = max(1, min(plan.realizations.lanes, chunk // (8 * self.length * count)))
                variable = self.data.createVariable(
                    item.quantity.name, "f8", ("realization", "time", item.dimension), fletcher32=True,
                    chunksizes=(lanes, self.length, count), complevel=1,
                    compression="zlib" if item.quantity.dimension == CONTACT else None,
                )  # fmt: skip
                variable.setncatts(plan.snapshot.attributes(item.quantity))
            time = self.data.createVariable("time", "f8", ("time",), fletcher32=True)
            _, times, attributes = self.record.times(samples, RecordedRun(plan).begin)
            time.setncatts(attributes)
            time[:] = times
            self.data.createVariable("realization", "i8", ("realization",), fletcher32=True)
            self.data["realization"].setncatts(REALIZATION)
            first = plan.realizations.numbered_from
            self.data["realization"][:] = first + np.arange(plan.realizations.number)

    def said(self) -> contextlib.AbstractContextManager[None]:
        """Say in words what goes wrong."""
        return told("The file of the trajectories, of which nothing is left,", self.path)

    def write(self, realizations: np.ndarray, begin: int, end: int, values: list[np.ndarray]) -> None:
        """Write samples [lane, sample, name] of what is kept of some realizations."""
        gapless = len(realizations) == realizations[-1] + 1 - realizations[0]
        rows: Any = slice(realizations[0], realizations[-1] + 1) if gapless else realizations.tolist()
        times = slice(begin, end)
        with LOCK, self.said():
            if self.closed:
                raise Interrupted("The simulation was stopped.")
            for item, own in zip(self.kept, values, strict=True):
                self.data[item.quantity.name][rows, times] = own

    def lose(self, places: np.ndarray) -> None:
        """Fill the rows of realizations that diverged with NaN."""
        with LOCK, self.said():
            for item in self.kept:
                for place in places.tolist():
                    self.data[item.quantity.name][place] = np.nan

    def close(self) -> None:
        """Write what the library has kept, and close the file."""
        with LOCK, self.said():
            self.closed = True
            self.data.close()


class Streamed:
    """In the place of a record of trajectories whose samples go to a file."""

    summed = ()

    def __init__(self, file: _File) -> None:
        self.file = file

    def read(self, plan: Plan) -> Sequence[int] | np.ndarray | None:
        return self.file.record.read(plan)

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Writer(self.file, run.plan, realizations, ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        return self.file.record.labels(run.plan.snapshot)  # the others are in the file


class _Writer(Sampler):
    """Collects samples of one block until there are enough to be written."""

    def __init__(self, file: _File, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(file.record, plan, ratio)
        shape = len(realizations), file.length
        self.waiting = [np.empty((*shape, len(item.names))) for item in self.kept]
        self.file, self.realizations, self.begin, self.count = file, realizations, 0, 0

    def take(self, samples: np.ndarray) -> None:
        while len(samples):
            some = samples[: self.file.length - self.count]
            end = self.count + len(some)
            for item, waiting in zip(self.kept, self.waiting, strict=True):
                waiting[:, self.count : end] = item.values(some).transpose(2, 0, 1)
            self.count, samples = end, samples[len(some) :]
            if self.count == self.file.length:
                self._write()

    def _write(self) -> None:
        values = [waiting[:, : self.count] for waiting in self.waiting]
        self.file.write(self.realizations, self.begin, self.begin + self.count, values)
        self.begin, self.count = self.begin + self.count, 0

    def result(self) -> dict[str, np.ndarray]:
        if self.count:
            self._write()
        return {}
