"""The folder of a study's run: parts while it is incomplete, then result, figures, report and manifest.

Every file is written under a temporary name and put in place whole, so that a run may
be killed at any moment. ``manifest.json`` says what the folder holds and whether it is
complete; it is written first and last.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import impactlab
from impactlab.components.component import Component
from impactlab.errors import InvalidInput

if TYPE_CHECKING:
    import xarray as xr

    from impactlab.studies.study import Item, Study

MANIFEST, RESULT, REPORT, FIGURES, ITEMS = "manifest.json", "result.nc", "report.html", "figures", "items"

KEPT = ".npz"
"""How names of items' files end."""

_ITEM = "impactlab_item"


class Folder:
    """Where a study's run is kept; made by :meth:`claim` if it does not exist."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        if not isinstance(path, str | os.PathLike):
            raise InvalidInput(f"A folder is given by its path, not {path!r}.")
        self.path = Path(path)

    def manifest(self) -> dict[str, Any]:
        """Return the contents of the manifest, or refuse a folder without one that can be read."""
        try:
            data: dict[str, Any] = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
            _ = data["study"], data["settings"], data["complete"]
        except (OSError, ValueError, LookupError, TypeError) as error:
            raise InvalidInput(
                f"{self.path} is not the folder of a study's run: there is no {MANIFEST} that can be read."
            ) from error
        return data

    def claim(self, study: Study) -> None:
        """Make the folder ready for a run of this study, before anything is computed.

        It is refused if it is a file, cannot be written to, or holds something else.
        """
        if self.path.exists() and not self.path.is_dir():
            raise InvalidInput(f"{self.path} is a file; give the name of a folder for the results.")
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            used = any(not entry.name.startswith(".") for entry in self.path.iterdir())
        except OSError as error:
            raise InvalidInput(
                f"Cannot use {self.path}: {error.strerror or error}. Give a folder that is writable."
            ) from error
        if used:
            other = self.manifest()["study"]
            if other != study.name:
                raise InvalidInput(
                    f"{self.path} holds a run of the study {other!r}; give another folder for {study.name!r}."
                )
        self.write_manifest(study, complete=False)

    def write_manifest(self, study: Study, *, complete: bool, **content: Any) -> None:
        """Write the manifest: the study, the versions, and the digest of each file."""
        data = {
            "study": study.name,
            "title": study.title,
            "settings": study.settings(),
            "complete": complete,
            "versions": versions(),
            **content,
        }
        self.write(MANIFEST, json.dumps(data, indent=2, ensure_ascii=False, default=float).encode())

    def write(self, name: str, content: bytes) -> str:
        """Write a file, whole or not at all; return its SHA-256."""
        from impactlab.results.dataset import replacing, told

        path = self.path / name
        path.parent.mkdir(exist_ok=True)
        with replacing(path) as temporary, told(str(path), temporary):
            temporary.write_bytes(content)
        return hashlib.sha256(content).hexdigest()

    def save_item(self, item: Item, result: xr.Dataset) -> None:
        """Keep the result of one item until the run is complete."""
        from impactlab.results.arrays_file import save_arrays

        (self.path / ITEMS).mkdir(exist_ok=True)
        save_arrays(result.assign_attrs({_ITEM: _identity(item)}), self._item_path(item))

    def load_item(self, item: Item) -> xr.Dataset | None:
        """Return an item's result that is kept, None if there is no whole one of this configuration."""
        from impactlab.results.arrays_file import load_arrays

        path = self._item_path(item)
        if not path.is_file():
            return None
        try:
            result = load_arrays(path)
        except InvalidInput:  # damaged: it is computed again
            return None
        return result if result.attrs.pop(_ITEM, None) == _identity(item) else None

    def _item_path(self, item: Item) -> Path:
        return self.path / ITEMS / f"{quote(item.key, safe=' =,+')}{KEPT}"

    def load_result(self) -> xr.DataTree:
        """Return the tree of a complete run; refuse it if the file is not the one that was written."""
        import xarray as xr

        from impactlab.results import dataset

        manifest = self.manifest()
        if not manifest["complete"]:
            raise InvalidInput(
                f"The run in {self.path} is not complete; continue it with: impactlab resume {self.path}"
            )
        path = self.path / RESULT
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != manifest["files"][RESULT]:
            raise InvalidInput(f"{path} has changed since the run wrote it; run the study again.")
        result = dataset.load(path)
        assert isinstance(result, xr.DataTree)
        return result

    def clean(self, figures: list[str]) -> None:
        """Remove the items' files, and figures of an earlier run that were not drawn again."""
        shutil.rmtree(self.path / ITEMS, ignore_errors=True)
        for kind in ("svg", "png"):
            for file in (self.path / FIGURES).glob(f"*.{kind}"):
                if f"{FIGURES}/{file.name}" not in figures:
                    file.unlink()


def versions() -> dict[str, str]:
    """Return the versions of the packages that made the numbers."""
    packages = ("numpy", "scipy", "numba", "xarray", "netCDF4", "matplotlib")
    found = {"impactlab": impactlab.__version__, "python": platform.python_version()}
    return found | {name: version(name) for name in packages} | {"platform": platform.platform()}


def _identity(item: Item) -> str:
    """Return a digest of everything that an item's numbers depend on."""
    content = {"network": item.network, "options": item.options, "impactlab": impactlab.__version__}
    return hashlib.sha256(json.dumps(plain_data(content), sort_keys=True).encode()).hexdigest()


def plain_data(value: Any) -> Any:
    """Return an item's options as data that JSON can hold, or refuse what is none, such as a random generator."""
    if isinstance(value, Component | impactlab.Network):
        return plain_data(value.to_dict())
    if isinstance(value, Mapping):
        return {str(key): plain_data(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain_data(item) for item in value]
    if hasattr(value, "tolist"):  # of numpy
        return plain_data(value.tolist())
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise InvalidInput(f"The options of a study's item must be plain data, not {value!r}.")
