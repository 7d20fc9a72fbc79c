"""The folder of a study's run: parts while it is incomplete, then result, figures, report and manifest.

Every file is written under a temporary name and put in place whole, so that a run may
be killed at any moment. ``manifest.json`` says what the folder holds and whether it is
complete; it is written first and last.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import shutil
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import impactlab
from impactlab.errors import InvalidInput
from impactlab.results.plain_values import digest

if TYPE_CHECKING:
    import xarray as xr

    from impactlab.results.checkpoint import Checkpoint
    from impactlab.studies.study import Item, Study

MANIFEST, RESULT, REPORT, FIGURES, ITEMS = "manifest.json", "result.nc", "report.html", "figures", "items"


class Folder:
    """Where a study's run is kept; made by :meth:`claim` if it does not exist."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)

    def manifest(self) -> dict[str, Any]:
        """Return the contents of the manifest, or refuse a folder without one that can be read."""
        try:
            data: dict[str, Any] = json.loads((self.path / MANIFEST).read_text(encoding="utf-8"))
            written = data.pop("digest", None)
            _ = data["study"], data["settings"], data["complete"]
        except (OSError, ValueError, LookupError, AttributeError, TypeError, RecursionError) as error:
            raise InvalidInput(
                f"{self.path} is not the folder of a study's run: there is no {MANIFEST} that can be read."
            ) from error
        if written not in (None, digest(json.dumps(data))):
            raise InvalidInput(
                f"{self.path / MANIFEST} is damaged, or was changed since the run wrote it; give another folder."
            )
        return data

    @contextlib.contextmanager
    def claimed(self, study: Study) -> Iterator[None]:
        """Make the folder ready for a run of this study, before anything is computed, and keep others from it.

        It is refused if it is a file, cannot be written to, holds something else, or another process works in it.
        """
        from impactlab.results.checkpoint import locked

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
        with locked(self.path.absolute()):
            self.write_manifest(study, complete=False)
            for file in self.path.rglob(".*.tmp"):  # of processes that were killed while they wrote
                file.unlink(missing_ok=True)
            yield

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
        plain = json.loads(json.dumps(data, default=float))
        data = {**plain, "digest": digest(json.dumps(plain))}
        self.write(MANIFEST, json.dumps(data, indent=2, ensure_ascii=False).encode())

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
        kept = self._kept()
        kept.item(_name(item)).save((_identity(item), result))
        kept.part(_name(item)).clear()

    def load_item(self, item: Item) -> xr.Dataset | None:
        """Return an item's result that is kept, None if there is no whole one of this configuration."""
        identity, result = self._kept().item(_name(item)).load() or (None, None)
        return result if identity == _identity(item) else None

    def part(self, item: Item) -> Checkpoint | None:
        """Return where parts of an item are kept while it runs; nowhere for one with a tolerance."""
        return None if item.options.get("tolerance") is not None else self._kept().part(_name(item))

    def _kept(self) -> Checkpoint:
        from impactlab.results.checkpoint import Checkpoint

        return Checkpoint(self.path / ITEMS, {})

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
        files = manifest.get("files")
        written = files.get(RESULT) if isinstance(files, dict) else None
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != written:
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


def _name(item: Item) -> str:
    return quote(item.key, safe=" =,+")


def _identity(item: Item) -> str:
    """Return a digest of everything that an item's numbers depend on."""
    from impactlab.results.plain_values import plain_data

    return digest(plain_data({"network": item.network, "options": item.options, "impactlab": impactlab.__version__}))
