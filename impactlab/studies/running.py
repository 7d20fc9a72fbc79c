"""A study from its configuration to its result and files."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Mapping
from concurrent.futures import Executor
from typing import TYPE_CHECKING, Any

from impactlab.inputs import checked
from impactlab.progress import is_shown
from impactlab.studies.discovery import make_study
from impactlab.studies.report import publish
from impactlab.studies.run_folder import Folder
from impactlab.studies.simulations import checked_workers, run_simulations, simulations
from impactlab.studies.study import DIVERGED, MISSED, Study, StudyResult, judged

if TYPE_CHECKING:
    import xarray as xr


@checked
def run_study(
    study: str | os.PathLike[str] | Study | type[Study],
    *,
    settings: Mapping[str, Any] | None = None,
    quick: bool = False,
    out: str | os.PathLike[str] | None = None,
    workers: int | None = None,
    executor: Executor | None = None,
    progress: bool | None = None,
) -> StudyResult:
    """Run a study: all simulations, then the verdicts, and with `out` the files.

    Parameters
    ----------
    study : str, path, Study or subclass of Study
        Name of a study, a TOML file, an instance or a class.
    settings : mapping, optional
        Values that replace those of the study.
    quick : bool
        Whether to run the study's smoke form.
    out : str or path, optional
        Folder for ``result.nc``, the figures, ``report.html`` and ``manifest.json``. It
        also keeps what is complete when a run is stopped: the same call continues it.
    workers : int, optional
        Number of threads; by default one per core. The numbers do not depend on it.
    executor : concurrent.futures.Executor, optional
        Where to run instead.
    progress : bool, optional
        Whether to show the progress on stderr; by default only on a terminal and in a notebook.

    Returns
    -------
    StudyResult

    Raises
    ------
    InvalidInput
        If the study, a setting or the folder cannot be used. Nothing has been computed then.

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
    checked_workers(workers)
    made = make_study(study, settings, quick)
    wanted = simulations(made)
    folder = None if out is None else Folder(out)
    with contextlib.nullcontext() if folder is None else folder.claimed(made):
        begin = time.perf_counter()
        results = run_simulations(wanted, folder, workers, executor, is_shown(progress))
        faults = {MISSED: _missed(results), DIVERGED: _lost(results)}
        tree = made.collect(results)
        tree.attrs |= {name: text for name, text in faults.items() if text}
        result = judged(made, tree, None if folder is None else folder.path)
        if folder is not None:
            publish(result, folder, begin)
    return result


def _lost(results: Mapping[str, xr.Dataset]) -> str:
    """Say how many realizations of which results diverged."""
    import numpy as np

    from impactlab.results.losses import LOSSES  # what is only described needs nothing that simulates

    numbers = {key: int(np.nansum(result.get(LOSSES, result.attrs.get(LOSSES, 0)))) for key, result in results.items()}
    return ", ".join(f"{number} of {key}" for key, number in numbers.items() if number)


def _missed(results: Mapping[str, xr.Dataset]) -> str:
    """Say which results have errors beyond the tolerance that was asked for, for want of time, and by how much."""
    name, found = "error_over_tolerance", []
    for key, result in results.items():
        error = float(result[name].max()) if name in result else result.attrs.get(name, 0.0)
        if error > 1.0:
            found.append(f"{key} {error:.3g} times")
    return ", ".join(found)
