"""Digests of what a file holds, by which damage, and changes by other programs, are noticed when it is read.

They are of values, not of bytes: a file may be compressed, cut into chunks or written anew in another byte order.
"""

from __future__ import annotations

import json
import math
import os
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab.given_files import NESTED
from impactlab.results.plain_values import digest

DIGESTS = "impactlab_digests"
"""Attribute of a file: digests, by the names of variables and attributes as netCDF's own tools write them."""

TILE = 1 << 16
"""Numbers of a variable that are in memory at once: a larger one is halved along its longest axis."""

DEFLATED = 1100
"""Bytes that one byte of a compressed file can hold at most: zlib's limit is 1032."""

ALWAYS_READ = 1e8
"""Data that are read whatever the file can hold (bytes): it need not hold what was never written."""

NAMED = 3
"""Variables and attributes that a refusal names."""


def digests_of(groups: Iterable[tuple[str, xr.Dataset]]) -> dict[str, str]:
    """Return digests of all variables with their dimensions and attributes, and of the attributes of all groups."""
    found = {}
    for path, dataset in groups:
        place = "" if path == "/" else f"{path}/"
        for name, variable in dataset.variables.items():
            attributes = {str(key): _plain(value) for key, value in sorted(variable.attrs.items())}
            whole = [list(map(str, variable.dims)), variable.shape, _of_values(variable), attributes]
            found[f"{place}{name}"] = digest(whole)
        found |= {f"{place}:{key}": digest(_plain(value)) for key, value in dataset.attrs.items() if key != DIGESTS}
    return found


def groups_of(tree: xr.DataTree) -> list[tuple[str, xr.Dataset]]:
    """Return the groups of a file, by their paths."""
    return [(node.path, node.to_dataset(inherit=False)) for node in tree.subtree]


def sign(path: Path) -> None:
    """Write digests of all that a file holds into the file."""
    with xr.open_datatree(path, engine="netcdf4") as tree:
        text = json.dumps(digests_of(groups_of(tree)))
    xr.Dataset(attrs={DIGESTS: text}).to_netcdf(path, mode="a", engine="netcdf4")


def check(path: Path, groups: list[tuple[str, xr.Dataset]], stored: Any, part: bool = False) -> None:
    """Refuse what was read from a file if it is not what was written: by damage, or by another program.

    Further variables and attributes may have been added. A file without digests was written by other means. Where only
    a part was read, variables may be missing.
    """
    if stored is None:
        return
    try:
        written: Mapping[str, str] = dict(json.loads(str(stored)))
    except (ValueError, TypeError, RecursionError):
        raise InvalidInput(f"{path} is damaged: its digests ({DIGESTS}) cannot be read.") from None
    found = digests_of(groups)
    read = [name for name in written if not part or name in found or name.startswith(":")]
    wrong = [name for name in read if found.get(name) != written[name]]
    if wrong:
        names = f"{', '.join(wrong[:NAMED])}{f' and {len(wrong) - NAMED} more' if len(wrong) > NAMED else ''}"
        raise InvalidInput(
            f"{path} does not hold what impactlab wrote: {names} differ{'s' * (len(wrong) == 1)}. The file is damaged, "
            "or was changed by another program. If you trust the change, open the file with xarray and write it with "
            "il.save."
        )


def check_size(path: Path, names: Collection[str] | None, memory: float) -> None:
    """Refuse a file whose variables, all or some, are declared to be larger than it can hold, or than memory can."""
    import netCDF4  # late: the library is loaded with the first file

    size = 0
    with netCDF4.Dataset(os.fspath(path)) as file:
        groups = [file]
        while groups:
            group = groups.pop()
            if group.path.count("/") > NESTED:  # xarray takes time with the square of them
                raise InvalidInput(f"{path} cannot be read: its groups are nested in more than {NESTED} levels.")
            known = [item for name, item in group.variables.items() if names is None or name in names]
            size += sum(math.prod(item.shape) * getattr(item.dtype, "itemsize", 8) for item in known)
            groups += group.groups.values()
    held = path.stat().st_size
    if size > max(ALWAYS_READ, DEFLATED * held):
        raise InvalidInput(f"{path} declares {size / 1e9:.3g} GB of data, but has {held / 1e6:.3g} MB.")
    if size > memory:
        raise InvalidInput(
            f"{path} holds {size / 1e9:.3g} GB, but {memory / 1e9:.3g} GB of memory are available: open it with "
            "xarray, which reads variables when they are needed."
        )


def _of_values(variable: xr.Variable) -> str:
    """Return a digest of the values of a variable, a tile at a time."""
    if variable.size <= TILE:
        return digest(_plain(variable.values))
    longest = max(variable.dims, key=lambda name: variable.sizes[name])
    middle = variable.sizes[longest] // 2
    return digest([_of_values(variable.isel({longest: part})) for part in (slice(middle), slice(middle, None))])


def _plain(values: Any) -> Any:
    """Return values of a variable or an attribute as numbers of 8 bytes, or texts, whatever a file has them as."""
    array = np.asarray(values)
    array = array if array.ndim else array[np.newaxis]  # an array of one number is a number when it is read
    if array.dtype.kind == "f":
        array = array.astype("<f8", copy=False)
        unknown = np.isnan(array)
        return np.where(unknown, np.nan, array) if unknown.any() else array
    if array.dtype.kind in "biumM":
        return array.astype("<i8", copy=False)
    return [item.decode(errors="replace") if isinstance(item, bytes) else str(item) for item in array.ravel().tolist()]
