"""Trajectories written to a netCDF file while the simulation runs, in constant memory."""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from impactlab.dataset import LOCK, told
from impactlab.errors import Interrupted, InvalidInput
from impactlab.plan import Plan
from impactlab.record import Keeper, Trajectory, Variables, first_own, sample_count, trajectory_size

CHUNK_BYTES = 1_000_000
"""Size of what is written at a time, and of a chunk of the file, if a sample of a block is not larger."""


@contextlib.contextmanager
def written(plan: Plan, path: Path, folder: Path) -> Iterator[Plan]:
    """Give the plan whose trajectories go to a new file instead of memory.

    Parameters
    ----------
    plan : Plan
        With a record of trajectories.
    path : Path
        File to be written.
    folder : Path
        Where it is, for messages.

    Raises
    ------
    InvalidInput
        If the disk has not enough space.
    ImpactLabError
        If the file cannot be written.
    """
    size, free = trajectory_size(plan), shutil.disk_usage(folder).free
    if size > free:
        raise InvalidInput(
            f"The trajectories would take up to {size / 1e9:.3g} GB, but {free / 1e9:.3g} GB are free in {folder}: use "
            "a longer interval or fewer realizations."
        )
    file = _File(plan, path)
    try:
        records = tuple(
            (_Streamed(file) if isinstance(item, Trajectory) else item, ratio) for item, ratio in plan.observed.records
        )
        yield replace(plan, observed=replace(plan.observed, records=records))
    finally:
        file.close()


class _File:
    """The file and its variables. What goes wrong while it is written is said in the words of impactlab."""

    def __init__(self, plan: Plan, path: Path) -> None:
        import netCDF4

        self.plan, self.path, self.closed = plan, path, False
        interval, samples = sample_count(plan)
        bodies, contacts = len(plan.system.bodies), len(plan.system.contacts)
        self.length = max(1, min(samples, CHUNK_BYTES // (8 * plan.realizations.lanes * (2 * bodies + contacts))))
        kinds = [("displacement", "m", "oscillator", bodies), ("velocity", "m s-1", "oscillator", bodies)]
        kinds += [("contact_force", "N", "contact", contacts)] if contacts else []
        with LOCK, self.said():
            self.data = netCDF4.Dataset(os.fspath(path), "w", format="NETCDF4")
            self.data.set_fill_off()  # everything is written
            realizations = plan.realizations.number
            sizes = {"realization": realizations, "time": samples, "oscillator": bodies, "contact": contacts}
            for name, count in sizes.items():
                if count:
                    self.data.createDimension(name, count)
            for name, units, dimension, count in kinds:
                lanes = max(1, min(plan.realizations.lanes, CHUNK_BYTES // (8 * self.length * count)))
                variable = self.data.createVariable(
                    name, "f8", ("realization", "time", dimension), fletcher32=True,
                    chunksizes=(lanes, self.length, count), compression="zlib" if dimension == "contact" else None,
                    complevel=1,
                )  # fmt: skip
                variable.setncatts({"units": units, "long_name": name.replace("_", " ")})
            time = self.data.createVariable("time", "f8", ("time",), fletcher32=True)
            time.setncatts({"units": "s", "long_name": "time"})
            time[:] = interval * np.arange(samples)
            self.data.createVariable("realization", "i8", ("realization",), fletcher32=True)
            self.data["realization"][:] = np.arange(plan.realizations.number)

    def said(self) -> contextlib.AbstractContextManager[None]:
        """Say in words what goes wrong."""
        return told("The file of the trajectories, of which nothing is left,", self.path)

    def write(self, realizations: np.ndarray, begin: int, values: np.ndarray) -> None:
        """Write samples [sample, quantity, lane] of some realizations, from the sample `begin` on."""
        rows, times = slice(realizations[0], realizations[-1] + 1), slice(begin, begin + len(values))
        bodies = len(self.plan.system.bodies)
        parts = {"displacement": slice(bodies), "velocity": slice(bodies, 2 * bodies)}
        parts |= {"contact_force": slice(2 * bodies, None)} if self.plan.system.contacts else {}
        with LOCK, self.said():
            if self.closed:
                raise Interrupted("The simulation was stopped.")
            for name, part in parts.items():
                self.data[name][rows, times] = values[:, part].transpose(2, 0, 1)

    def close(self) -> None:
        """Write what the library has kept, and close the file."""
        with LOCK, self.said():
            self.closed = True
            self.data.close()


class _Streamed:
    """In the place of a record of trajectories whose samples go to a file."""

    summed = ()

    def __init__(self, file: _File) -> None:
        self.file = file

    def keeper(self, plan: Plan, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Writer(self.file, realizations, ratio)

    def label(self, plan: Plan, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        return {}  # they are in the file


class _Writer(Keeper):
    """Collects samples of one block until there are enough to be written."""

    wants_start = True

    def __init__(self, file: _File, realizations: np.ndarray, ratio: int) -> None:
        quantities = 2 * len(file.plan.system.bodies) + len(file.plan.system.contacts)
        self.waiting = np.empty((file.length, quantities, len(realizations)))
        self.file, self.realizations, self.ratio = file, realizations, ratio
        self.seen = self.begin = self.count = 0

    def start(self, values: np.ndarray) -> None:
        self._take(values[None])

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own = snapshots[first_own(self.seen, self.ratio) :: self.ratio]
        self.seen += len(snapshots)
        self._take(own)

    def _take(self, samples: np.ndarray) -> None:
        while len(samples):
            some = samples[: len(self.waiting) - self.count]
            self.waiting[self.count : self.count + len(some)] = some
            self.count += len(some)
            samples = samples[len(some) :]
            if self.count == len(self.waiting):
                self._write()

    def _write(self) -> None:
        self.file.write(self.realizations, self.begin, self.waiting[: self.count])
        self.begin, self.count = self.begin + self.count, 0

    def result(self) -> dict[str, np.ndarray]:
        if self.count:
            self._write()
        return {}
