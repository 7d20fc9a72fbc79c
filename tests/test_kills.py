"""Programs that are killed, or lose their workers, and go on: a campaign, with a quick form in the full tests.

``IMPACTLAB_KILLS=100 python -m pytest tests/test_kills.py -m campaign -rP`` kills so many programs and workers, and
prints what it has counted.
"""

import importlib.util
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter

import bits
import numpy as np
import pytest
import xarray as xr

from impactlab.results.dataset import load

psutil = pytest.importorskip("psutil")

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are killed here by signals")

QUESTIONS = "simulate", "one", "sweep", "basins", "study"
ENGINES = "threads", "processes", "fork", "spawn", "dask", "mpi"
KILLS = int(os.environ.get("IMPACTLAB_KILLS", "30"))
REPLACING = "processes", "dask"  # their workers are replaced
WITHOUT_EXECUTOR = {("one", engine) for engine in ENGINES[1:]} | {("study", "mpi")}  # one block; names of its class

PROGRAM = """
import argparse, contextlib, concurrent.futures, multiprocessing, sys, warnings
sys.path.insert(0, {tests!r})
import xarray as xr
from long_questions import answer
from scenes import base
import impactlab as il
from impactlab.command_line.engines import Served, engine
from impactlab.studies.study import Item, Study, SweepItem

def make(clearance):
    return base(clearance=clearance)

class Clearances(Study):
    name, title = "clearances", "Two bodies at several clearances"

    def items(self):
        options = dict(duration=400.0, realizations=64, rng=1)
        return [Item("one", base(), options), SweepItem("two", make, {{"clearance": [0.02, 0.05, 0.1]}}, options)]

    def collect(self, results):
        return xr.DataTree.from_dict({{f"/{{name}}": item for name, item in results.items()}})

@contextlib.contextmanager
def executor_of(kind):
    if kind in ("fork", "spawn"):
        with concurrent.futures.ProcessPoolExecutor(2, multiprocessing.get_context(kind)) as pool:
            yield pool
    else:
        chosen = argparse.Namespace(
            processes=2 if kind == "processes" else None, dask="local" if kind == "dask" else None, mpi=kind == "mpi"
        )
        with engine(chosen) as executor:
            yield executor

def run(question, kind, folder, out):
    with executor_of(kind) as executor:
        kept = {{"executor": executor}} if folder == "-" else {{"executor": executor, "checkpoint": folder}}
        print("begun", flush=True)
        if question == "study":
            found = il.run_study(Clearances(), out=None if folder == "-" else folder, executor=executor).tree
        else:
            found = answer(question, make, 30, 150, **kept)
        il.save(found, out)

if __name__ == "__main__":
    warnings.simplefilter("ignore")
    try:
        run(*sys.argv[1:])
    except Served:
        pass
"""


def command_of(script, question, engine, folder, out):
    mpi = ["mpiexec", "--oversubscribe", "--allow-run-as-root", "-n", "3"] if engine == "mpi" else []
    return [*mpi, sys.executable, str(script), question, engine, str(folder), str(out)]


def numbers(path):
    found = load(path)
    nodes = found.subtree if isinstance(found, xr.DataTree) else [found]
    return [
        {name: np.asarray(item).tobytes() for name, item in node.variables.items() if item.dtype.kind in "fiu"}
        for node in nodes
    ]


def there(engine):
    needed = {"dask": "distributed", "mpi": "mpi4py"}.get(engine)
    return (needed is None or importlib.util.find_spec(needed)) and (engine != "mpi" or shutil.which("mpiexec"))


class Campaign:
    """Programs that answer the same questions, whole and killed."""

    def __init__(self, folder, seed):
        self.folder, self.drawn, self.count, self.whole = folder, random.Random(seed), Counter(), {}
        self.script = folder / "program.py"
        self.script.write_text(PROGRAM.format(tests=os.path.dirname(bits.__file__)), encoding="utf-8")
        self.longest = 0.0  # work that was done again (s)

    def expected(self, question):
        """The numbers of a whole run, and how long it takes (s)."""
        if question not in self.whole:
            out = self.folder / f"{question}.nc"
            for _ in range(2):  # the first one compiles
                begin = time.monotonic()
                subprocess.run(
                    command_of(self.script, question, "threads", "-", out), check=True, stdout=subprocess.DEVNULL
                )
            self.whole[question] = numbers(out), time.monotonic() - begin
        return self.whole[question]

    def kill(self, question, engine, kills):
        """Kill a program or its workers so often, let it end, and compare."""
        expected, usual = self.expected(question)
        place = self.folder / f"{question}-{engine}-{self.count['killed']}"
        place.mkdir()
        kept, out = place / "kept", place / "found.nc"
        command = command_of(self.script, question, engine, kept, out)
        for last in [False] * kills + [True]:
            with (place / "errors").open("w+") as errors:  # a pipe would be held open by workers that outlive it
                process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, start_new_session=True)
                process.stdout.readline()
                if not last:
                    self._strike(process, kept, engine, usual)
                process.wait(timeout=100)
                process.stdout.close()
                self._gone(process, engine)
                if process.returncode > 0:
                    self.count["in words" if errors.seek(0, 2) else "silent"] += 1
            if process.returncode == 0:
                break
        same = process.returncode == 0 and numbers(out) == expected
        self.count["differ"] += not same
        left = [path for path in kept.rglob("*") if path.name.endswith((".tmp", ".state", ".lock", ".losses"))]
        self.count["files left"] += len(left)
        self.count["programs"] += 1
        shutil.rmtree(place)
        print(question, engine, dict(self.count), flush=True)

    def _strike(self, process, kept, engine, usual):
        """Wait at random, and kill the program or one of its workers."""
        with_workers = engine != "threads"
        try:
            process.wait(self.drawn.uniform(0.02, 0.7) * usual)
            return
        except subprocess.TimeoutExpired:
            pass
        parent = psutil.Process(process.pid)
        children = [
            item for item in parent.children(recursive=True) if "resource_tracker" not in " ".join(item.cmdline())
        ]
        victim = self.drawn.choice(children) if with_workers and children and self.drawn.random() < 0.5 else parent
        files = [path.stat().st_mtime for path in kept.rglob("*.*") if path.suffix in (".item", ".state")]
        if files:
            self.longest = max(self.longest, time.time() - max(files))
        victim.send_signal(signal.SIGKILL)
        self.count["killed"] += 1
        self.count["killed workers"] += victim is not parent

    def _gone(self, process, engine):
        """Count processes of a program that outlive it; those of the standard library's pools do so by themselves."""
        for _ in range(200):  # those that are still to begin end a little later
            alive = [item for item in psutil.process_iter() if _session(item) == process.pid]
            if not alive:
                return
            time.sleep(0.1)
        self.count["workers of pools left" if engine in ("fork", "spawn") else "processes left"] += len(alive)
        for item in alive:
            item.kill()


def _session(process):
    try:
        return os.getsid(process.pid) if process.status() != psutil.STATUS_ZOMBIE else None
    except (OSError, psutil.Error):
        return None


def good(campaign):
    print(dict(campaign.count), f"longest time since something was kept: {campaign.longest:.1f} s")
    assert campaign.count["killed"] > 0
    for fault in ("differ", "silent", "files left", "processes left"):
        assert campaign.count[fault] == 0, fault


@pytest.mark.full
def test_a_killed_worker_and_a_killed_program(tmp_path):
    campaign = Campaign(tmp_path, 1)
    for engine in ("threads", "processes"):
        campaign.kill("sweep", engine, 1)
    good(campaign)


@pytest.mark.campaign
def test_many_kills(tmp_path):
    campaign = Campaign(tmp_path, KILLS)
    pairs = [
        (question, engine)
        for question in QUESTIONS
        for engine in ENGINES
        if there(engine) and (question, engine) not in WITHOUT_EXECUTOR
    ]
    while campaign.count["killed"] < KILLS:
        campaign.kill(*campaign.drawn.choice(pairs), 2)
    good(campaign)
