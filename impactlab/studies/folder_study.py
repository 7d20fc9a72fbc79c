"""Studies whose parts are modules of one folder, imported when they are needed."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from impactlab.errors import InvalidInput
from impactlab.studies.claims import Check, checks_of, table_of
from impactlab.studies.study import Study

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure


class FolderStudy(Study):
    """A study with a folder of its own: this class in one module, each part in another.

    A part is a function with the name of its module: ``collect(study, results)`` and, if there are such modules,
    ``claims(study, tree)``, which yields :class:`~impactlab.studies.Claim`, ``checks(study, tree)``,
    ``tables(study, tree)`` and ``figures(study, tree)``. So a study is listed and configured without the packages that
    its parts import.
    """

    folder: ClassVar[str] = ""
    """The package that holds the class and its parts."""

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if FolderStudy in cls.__bases__:
            cls.folder = cls.__module__.rpartition(".")[0]

    @classmethod
    def makes(cls, part: str) -> bool:
        """Whether the folder has a module of that name, or the class a method of its own."""
        own = getattr(cls, part) is not getattr(FolderStudy, part)
        return own or importlib.util.find_spec(f"{cls.folder}.{part}") is not None

    def part(self, name: str) -> Callable[..., Any] | None:
        """Return the function of a part, or None if the folder has no such module."""
        place = f"{self.folder}.{name}"
        if importlib.util.find_spec(place) is None:
            return None
        part: Callable[..., Any] = getattr(importlib.import_module(place), name)
        return part

    def collect(self, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
        """Return the tree that the part ``collect`` makes of the results."""
        collect = self.part("collect")
        if collect is None:
            raise InvalidInput(f"{type(self).__name__} needs a module {self.folder}.collect with a function collect.")
        tree: xr.DataTree = collect(self, results)
        return tree

    def claims(self, tree: xr.DataTree) -> xr.Dataset:
        """Return the claims of the part as a table."""
        claims = self.part("claims")
        return table_of(claims(self, tree)) if claims else super().claims(tree)

    def checks(self, tree: xr.DataTree) -> list[Check]:
        """Return the checks of the part; without one, that no claim was found to be wrong."""
        checks = self.part("checks")
        return list(checks(self, tree)) if checks else checks_of(self.claims(tree))

    def tables(self, tree: xr.DataTree) -> Iterable[tuple[str, list[dict[str, Any]]]]:
        """Yield the tables of the part."""
        tables = self.part("tables")
        return tables(self, tree) if tables else super().tables(tree)

    def figures(self, tree: xr.DataTree) -> Iterable[tuple[str, Figure]]:
        """Yield the figures of the part."""
        figures = self.part("figures")
        return figures(self, tree) if figures else super().figures(tree)
