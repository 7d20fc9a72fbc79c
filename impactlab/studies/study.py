"""Studies: sets of simulations with a configuration, claims, checks, figures and a report."""

from __future__ import annotations

import dataclasses
import fnmatch
import functools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple, Self

from impactlab.components.component import Component
from impactlab.studies.claims import Check

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

    from impactlab import Network


MISSED, DIVERGED = "tolerances_missed", "realizations_diverged"
"""Attributes of a tree that say which simulations did not reach their tolerance, and which lost realizations."""

FAULTS = {MISSED: ("tolerances", "Not reached in the time"), DIVERGED: ("finite numbers", "Realizations that diverged")}
"""By these attributes, names and words of the checks that then fail."""


class Item(NamedTuple):
    """One simulation of a study: pure data, ``il.simulate(network, **options)``."""

    key: str
    network: Network
    options: dict[str, Any]


class SweepItem(NamedTuple):
    """One sweep of a study: ``il.sweep(make_network, over, **options)``. No point may be refused."""

    key: str
    make_network: Callable[..., Network | tuple[Network, Mapping[str, Any]]]
    over: Mapping[str, Sequence[Any]]
    options: dict[str, Any]


class Study(Component):
    """A set of simulations that is configured, run, judged and reported as one.

    The fields of a subclass, declared with :func:`impactlab.parameter`, are the keys of
    its TOML file; each needs a default. They are of type float, int, bool, str or a
    tuple of float, int or str. A subclass is found by the entry point that names it in
    the group ``impactlab.studies``.

    Examples
    --------
    >>> import xarray as xr
    >>> from impactlab.studies import Item
    >>> class Contacts(il.Study):
    ...     name = "contacts"
    ...     title = "Time in contact"
    ...
    ...     def items(self):
    ...         yield Item("one", network, {"duration": 20.0, "realizations": 64, "rng": 1})
    ...
    ...     def collect(self, results):
    ...         return xr.DataTree.from_dict({"statistics": results["one"]})
    >>> outcome = il.run_study(Contacts)
    >>> outcome.passed
    True
    """

    name: ClassVar[str]
    """Name of the entry point, such as ``two-system``."""

    title: ClassVar[str]
    """One line that describes the study."""

    captions: ClassVar[Mapping[str, str]] = {}
    """What is seen in each figure, by its name; a name may end in ``*``."""

    sections: ClassVar[Mapping[str, str]] = {}
    """What is claimed in each section of the claims, by its name; known before a run, as claims are not."""

    required: ClassVar[tuple[str, ...]] = ("name", "title", "items", "collect")

    if TYPE_CHECKING:

        def items(self) -> Sequence[Item | SweepItem]:
            """Return the simulations and sweeps of the study."""

        def collect(self, results: Mapping[str, xr.Dataset]) -> xr.DataTree:
            """Return the result of the study from the datasets of simulations and sweeps by key."""

    def quick(self) -> Self:
        """Return the study's smoke form: the same code, a few seconds."""
        return self

    def claims(self, tree: xr.DataTree) -> xr.Dataset:
        """Return the verdicts on the statements that the study audits.

        Returns
        -------
        Dataset
            Dimension ``claim``; texts ``statement``, ``section``, ``measured`` and
            ``verdict``, one of :data:`impactlab.studies.VERDICTS`. Empty if there are none.
        """
        import xarray as xr

        return xr.Dataset()

    def figures(self, tree: xr.DataTree) -> Iterable[tuple[str, Figure]]:
        """Yield the study's figures with their names."""
        return ()

    def checks(self, tree: xr.DataTree) -> list[Check]:
        """Return the study's own checks; the command line exits with 1 when one fails."""
        return []

    def tables(self, tree: xr.DataTree) -> Iterable[tuple[str, list[dict[str, Any]]]]:
        """Yield further tables for the report: a title and rows, column to text or number."""
        return ()

    @classmethod
    def makes(cls, part: str) -> bool:
        """Whether the study has "claims", "checks", "figures" or "tables" of its own."""
        return getattr(cls, part) is not getattr(Study, part)

    @classmethod
    def caption(cls, figure: str) -> str:
        """Return the caption of a figure: its own, or the caption of a pattern with ``*``; else the name as words."""
        found = [text for name, text in cls.captions.items() if fnmatch.fnmatchcase(figure, name)]
        return cls.captions.get(figure) or (found[0] if found else figure.replace("_", " "))

    def settings(self) -> dict[str, Any]:
        """Return the fields as plain data, as a TOML file has them."""
        data = self.to_dict()
        del data["type"]
        return data


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """What a study found."""

    study: Study  # the study with its settings
    tree: xr.DataTree  # what its `collect` made, with the claims in the group ``claims``
    checks: list[Check]  # the study's own checks
    folder: Path | None = None  # where the files are, if there are any

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.ok for check in self.checks)

    @property
    def claims(self) -> xr.Dataset:
        """Verdicts on the statements that the study audits, along ``claim``."""
        return self.tree.children["claims"].to_dataset(inherit=False)

    @functools.cached_property
    def figures(self) -> dict[str, Figure]:
        """The study's figures by name, drawn when they are first asked for."""
        from impactlab.plotting.style import style

        with style():
            return dict(self.study.figures(self.tree))


def judged(study: Study, tree: xr.DataTree, folder: Path | None = None) -> StudyResult:
    """Return the result of a study from its tree, with attributes, claims and checks, and the folder it is kept in."""
    import xarray as xr

    from impactlab.components.literature import in_one_line
    from impactlab.components.stored import entries
    from impactlab.results.dataset import provenance

    tree = tree.copy()
    references = in_one_line(entries({"type": type(study).__name__}))
    configuration = {"study": {"name": study.name, "settings": study.settings()}}
    attributes = provenance(study.title, json.dumps(configuration), references)
    if "history" in tree.attrs:  # the tree of an earlier run, judged again
        attributes["history"] = f"{tree.attrs['history']}\n{attributes['history']}"
    tree.attrs.update(attributes)
    tree["claims"] = xr.DataTree(study.claims(tree))
    failed = [
        Check(name, False, f"{words}: {tree.attrs[fault]}.")
        for fault, (name, words) in FAULTS.items()
        if fault in tree.attrs
    ]
    return StudyResult(study, tree, [*study.checks(tree), *failed], folder)
