"""Where a command computes: threads, processes of this machine, a dask cluster, or MPI."""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

from impactlab.errors import ImpactLabError, InvalidInput

_FAILED_CONNECTION = 30
"""Time after which a dask scheduler that does not answer is given up (s)."""


class Served(ImpactLabError):
    """A process of MPI other than the first has served it to its end, and has nothing to do any more."""


def add_engines(parser: argparse.ArgumentParser) -> None:
    """Add the options that choose where to compute."""
    engines = parser.add_mutually_exclusive_group()
    engines.add_argument("--workers", type=int, metavar="N", help="number of threads (default: one per core)")
    engines.add_argument("--processes", type=int, metavar="N", help="compute in so many processes of this machine")
    engines.add_argument("--dask", metavar="ADDRESS", help="compute on a dask cluster: tcp://HOST:PORT, or local")
    engines.add_argument("--mpi", action="store_true", help="compute in the processes that mpiexec has started")


@contextlib.contextmanager
def engine(options: argparse.Namespace, modules: Sequence[str] = ()) -> Iterator[Executor | None]:
    """Give the executor that options choose, None for threads; its workers import some modules, or .py files, first."""
    if options.processes is not None and options.processes < 1:
        raise InvalidInput(f"--processes is a whole number of at least 1, not {options.processes}.")
    if options.processes is not None:
        from impactlab.simulation.worker_processes import Processes

        with Processes(options.processes, import_all, tuple(modules)) as processes:
            yield processes
    elif options.dask is not None:
        with _dask(options.dask, modules) as executor:
            yield executor
    elif options.mpi:
        with _mpi() as executor:
            yield executor
    else:
        yield None


@contextlib.contextmanager
def _dask(address: str, modules: Sequence[str]) -> Iterator[Executor]:
    try:
        from distributed import Client
    except ImportError as error:
        raise InvalidInput('--dask needs dask: python -m pip install "impactlab[dask]".') from error
    from impactlab.machine import cores

    try:
        client = (
            Client(n_workers=cores(), threads_per_worker=1, processes=True, dashboard_address=None)
            if address == "local"
            else Client(address, timeout=_FAILED_CONNECTION)
        )
    except (OSError, ValueError, TypeError) as error:
        raise InvalidInput(
            f"--dask: no scheduler answers at {address!r} ({error}); give tcp://HOST:PORT as dask scheduler prints it, "
            "or local."
        ) from error
    with client:
        for module in modules:
            if module.endswith(".py"):
                client.upload_file(module)
        executor: Any = client.get_executor(pure=False)
        executor._max_workers = sum(client.nthreads().values()) or None
        yield executor


@contextlib.contextmanager
def _mpi() -> Iterator[Executor]:
    try:
        from mpi4py import MPI
        from mpi4py.futures import MPICommExecutor
    except ImportError as error:
        raise InvalidInput('--mpi needs mpi4py: python -m pip install "impactlab[mpi]".') from error
    if MPI.COMM_WORLD.Get_size() < 2:
        raise InvalidInput("--mpi needs at least two processes, of which one leads: mpiexec -n 3 impactlab … --mpi.")
    leads = MPI.COMM_WORLD.Get_rank() == 0
    with MPICommExecutor(MPI.COMM_WORLD, root=0) as executor:  # where the others serve until the first has ended
        if leads:
            yield executor
    if not leads:
        raise Served


def import_all(modules: Sequence[str]) -> None:
    """Import modules, or files of Python, as the user asks for."""
    import importlib.util
    import sys

    for module in modules:
        try:
            if not module.endswith(".py"):
                sys.path.insert(0, "")
                importlib.import_module(module)
                continue
            name = Path(module).stem
            spec = importlib.util.spec_from_file_location(name, module)
            assert spec is not None
            assert spec.loader is not None
            sys.modules[name] = found = importlib.util.module_from_spec(spec)
            spec.loader.exec_module(found)
        except Exception as error:  # whatever it does when it is imported
            raise InvalidInput(f"Cannot import {module}: {type(error).__name__}: {error}") from error
