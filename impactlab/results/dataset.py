"""Labelled results: variables with units, provenance, and files that are whole or absent."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import shutil
import tempfile
from collections.abc import Collection, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import xarray as xr

import impactlab
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.given_files import bounded, file_of
from impactlab.inputs import checked, shown
from impactlab.interrupts import UninterruptedLock
from impactlab.memory_limits import available
from impactlab.results.accessor import Accessor
from impactlab.results.contents import DIGESTS, check, check_size, groups_of, sign
from impactlab.results.snapshot import AT_POINTS, QUANTITIES, STATES
from impactlab.results.stored_options import check_options

xr.register_dataset_accessor("impactlab")(Accessor)  # type: ignore[no-untyped-call]

CONFIGURATION = "impactlab_configuration"


LOCK = UninterruptedLock()
LOCK.guard_forks()
"""Held around every call of the netCDF library, which is not thread-safe and cannot be interrupted."""

FULL = 1_000_000
"""Free space (bytes) below which a disk counts as full when a file could not be written."""


def provenance(title: str, configuration: str, references: str) -> dict[str, str]:
    """Return the global attributes that say what a dataset is, how to make it again, and what it rests on.

    The configuration is a text in JSON.
    """
    now = datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    return {
        "Conventions": "CF-1.11",
        "title": title,
        "source": f"impactlab {impactlab.__version__}",
        "history": f"{now} made by impactlab {impactlab.__version__}",
        "references": references,
        CONFIGURATION: configuration,
    }


BEGIN = "begin"
"""Attribute with the time at which statistics begin, of a run that goes on from an earlier one (s)."""


def configuration_of(source: xr.Dataset | xr.DataTree | str | os.PathLike[str]) -> dict[str, Any]:
    """Return the configuration stored with a dataset or a file; refuse what impactlab did not make."""
    if not isinstance(source, xr.Dataset | xr.DataTree | str | os.PathLike):
        raise InvalidInput(f"Give a dataset returned by simulate, or the path of its file, not {source!r}.")
    dataset = source if isinstance(source, xr.Dataset | xr.DataTree) else load(source)
    stored = dataset.attrs.get(CONFIGURATION)
    if isinstance(dataset, xr.Dataset) and CONFIGURATION in dataset and dataset[CONFIGURATION].ndim == 0:
        stored = dataset[CONFIGURATION].item()  # a point of a sweep
    if stored is None:
        raise InvalidInput(
            f"There is no attribute {CONFIGURATION!r}: give a dataset returned by simulate, or its file."
        )
    return parsed(stored)


def parsed(stored: Any) -> dict[str, Any]:
    """Return the configuration that a text holds, or refuse what is none."""
    try:
        configuration = json.loads(str(stored))
        bounded(configuration)
    except (ValueError, RecursionError) as error:
        raise InvalidInput(f"The stored configuration cannot be read: {error}.") from error
    if not isinstance(configuration, dict):
        raise InvalidInput(f"The stored configuration is not a mapping: {shown(configuration)}.")
    check_options(configuration)
    return configuration


@checked
def save(dataset: xr.Dataset | xr.DataTree, path: str | os.PathLike[str]) -> str:
    """Write a dataset or a tree to netCDF: the file is whole, or it is not there.

    Every array carries a checksum that the netCDF library verifies when it is read, and the file a digest of each
    variable and attribute, which `load` verifies.

    Parameters
    ----------
    dataset : Dataset or DataTree
        What to write.
    path : str or path
        Where; an existing file is replaced.

    Returns
    -------
    str
        SHA-256 of the file, in hexadecimal.

    Raises
    ------
    InvalidInput
        If the folder does not exist or cannot be written to, the path is a folder, or
        `dataset` is not one.
    ImpactLabError
        If the file cannot be written, for want of space, say.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> result = il.simulate(network, 20.0, realizations=64, rng=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "result.nc")
    ...     digest = il.save(result, path)
    ...     il.network_of(path) == network
    True
    """
    path = Path(path)
    with LOCK, replacing(path) as temporary, told(str(path), temporary):
        if isinstance(dataset, xr.DataTree):
            encoding = {
                node.path: _encoding(node.to_dataset(inherit=False)) for node in dataset.subtree if node.data_vars
            }
            dataset.to_netcdf(temporary, engine="netcdf4", format="NETCDF4", encoding=encoding)
            sign(temporary)
        else:
            write(dataset, temporary)
    return hashlib.sha256(path.read_bytes()).hexdigest()


@contextlib.contextmanager
def told(what: str, file: Path) -> Iterator[None]:
    """Say in words what goes wrong while a file is written."""
    try:
        yield
    except (OSError, RuntimeError) as error:  # the netCDF library raises both, and does not say that a disk is full
        free = shutil.disk_usage(file.parent).free if file.parent.is_dir() else 0
        reason = (
            f"no space is left in {file.parent}" if free < FULL else "the disk, a limit or the folder may be the cause"
        )
        raise ImpactLabError(f"{what} cannot be written: {reason} ({error}).") from error


def write(dataset: xr.Dataset, path: Path, *, append: bool = False) -> None:
    """Write a dataset to a file as it is, or add it to what is in one, with digests of all."""
    with LOCK:
        dataset.to_netcdf(
            path, mode="a" if append else "w", engine="netcdf4", format="NETCDF4", encoding=_encoding(dataset)
        )
        sign(path)


def opened(path: Path) -> xr.Dataset:
    """Return the dataset in a file, all in memory but its trajectories, which are read when they are needed."""
    lazy = (*QUANTITIES, STATES.name, *(item.name for item in AT_POINTS.values()))
    with LOCK:
        dataset = xr.open_dataset(path, engine="netcdf4", lock=LOCK)
        for name, variable in dataset.variables.items():
            if name not in lazy:
                variable.load()
    dataset.attrs.pop(DIGESTS, None)
    return dataset


@checked
def load(path: str | os.PathLike[str]) -> xr.Dataset | xr.DataTree:
    """Read a file that `save` wrote, all of it, or refuse it if it does not hold what was written.

    Variables and attributes that other programs added are read as well; a file without digests, as xarray writes it, is
    read as it is. No code runs, whatever is in the file.

    Parameters
    ----------
    path : str or path
        A netCDF file.

    Returns
    -------
    Dataset or DataTree
        A tree if the file has groups.

    Raises
    ------
    InvalidInput
        If there is no such file, it is damaged or was changed, or it does not fit into memory.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> result = il.simulate(network, 20.0, realizations=64, rng=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "result.nc")
    ...     digest = il.save(result, path)
    ...     il.load(path).identical(result)
    True
    """
    with LOCK, _read(path) as file:
        check_size(file, None, available())
        with xr.open_datatree(file, engine="netcdf4") as tree:
            loaded = tree.load()
    if not (loaded.attrs or loaded.children or loaded.variables):  # so is a netCDF 3 file whose end is cut off
        raise InvalidInput(f"{file} holds nothing: it is damaged, or was never written.")
    check(file, groups_of(loaded), loaded.attrs.pop(DIGESTS, None))
    return loaded if loaded.children else loaded.to_dataset()


def part_of(path: str | os.PathLike[str], names: Collection[str]) -> xr.Dataset:
    """Return the attributes of a file and the named variables as far as present; large variables may stay unread."""
    with LOCK, _read(path) as file:
        check_size(file, names, available())
        with xr.open_dataset(file, engine="netcdf4") as dataset:
            part = dataset[[name for name in names if name in dataset]].load()
    check(file, [("/", part)], part.attrs.pop(DIGESTS, None), part=True)
    return part


@contextlib.contextmanager
def _read(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Refuse a file that is not there, or that the netCDF library cannot read."""
    file = file_of(path)
    try:
        yield file
    except InvalidInput:
        raise
    except Exception as error:  # whatever the libraries make of a file that nobody may have written
        # NC_ENOTNC: the file is of another kind
        if getattr(error, "errno", None) == -51:
            raise InvalidInput(f"{file} is no netCDF file, such as impactlab writes.") from error
        raise InvalidInput(f"{file} cannot be read: {error}") from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path that replaces `path`, whole and on disk, when all went well."""
    if path.is_dir():
        raise InvalidInput(f"{path} is a folder; give the name of a file.")
    try:
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.parent)
    except OSError as error:
        raise InvalidInput(
            f"Cannot write {path}: {error.strerror or error}. Give a folder that exists and is writable."
        ) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        with told(str(path), temporary):
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
            os.chmod(temporary, 0o666 & ~_umask())
            os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.truncate(temporary, 0)  # the library may not have closed it, and would keep its space
        temporary.unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _encoding(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Ask for a checksum on every variable that can have one, arrays of numbers, and for complete coordinates."""
    encoding: dict[str, dict[str, Any]] = {}
    for name, variable in dataset.variables.items():
        if variable.dtype.kind in "fiu":
            encoding[str(name)] = {"fletcher32": True} if variable.ndim and variable.size else {}
            if name in dataset.coords and variable.ndim < 2:  # those of more are padded for points with fewer samples
                encoding[str(name)]["_FillValue"] = None
    return encoding
