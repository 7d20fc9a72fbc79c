"""Random work in one process, and what it leaves: ``python tests/long_lived.py SECONDS [SEED]`` prints a line a minute.

Networks of several kinds, contact laws that nobody has used before, sweeps, records, files, plots that are closed.
"""

import gc
import importlib.util
import os
import random
import sys
import tempfile
import threading
import time
import warnings
from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt

import impactlab as il

LAW = """import impactlab as il


class OwnContact(il.ContactLaw):
    stiffness: float = il.parameter(units="N m-1", minimum=0.0)

    @staticmethod
    def force(indentation, stiffness):
        return stiffness * indentation * (1.0 + {number!r} * indentation)
"""


def new_law(folder, number):
    """Return a contact law that differs from all before, from a module that is forgotten."""
    file = folder / f"law_{number}.py"
    file.write_text(LAW.format(number=number + random.random()), encoding="ascii")
    spec = importlib.util.spec_from_file_location(file.stem, file)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.OwnContact(1e3)


def network(law):
    """Return a network with random numbers and a law between two of its bodies."""
    body = il.LinearOscillator(stiffness=random.uniform(1.0, 50.0), damping=1.0)
    noise = il.WhiteNoise(random.uniform(0.5, 2.0))
    if random.random() < 0.3:
        return il.chain(random.choice([3, 6, 20]), body, law, clearance=0.02, excitation=noise)
    gap = il.Contact("a", random.choice(["b", il.WALL]), law, clearance=random.uniform(0.0, 0.3))
    return il.Network({"a": body, "b": body}, {"gap": gap}, {"a": noise, "b": noise})


def work(folder, number):
    """Do one thing."""
    kind = random.randrange(6)
    if kind == 0:
        il.simulate(network(new_law(folder, number)), 2.0, realizations=8, rng=1)
        return
    own = network(random.choice([il.HertzContact(random.uniform(1e2, 1e5)), il.LinearContact(1e3)]))
    if kind == 1:
        record = random.choice([il.Density(bins=50), il.PeakForces(), il.FinalState(), il.PerRealization()])
        il.simulate(own, 5.0, realizations=random.choice([8, 64]), record=record, rng=number)
    elif kind == 2:
        bodies = {"a": il.LinearOscillator(stiffness=10.0, damping=1.0)}
        stop = lambda d: {"stop": il.Contact("a", il.WALL, il.HertzContact(1e3), clearance=d)}  # noqa: E731
        make = lambda d: il.Network(bodies, stop(d), {"a": il.WhiteNoise(1.0)})  # noqa: E731
        il.sweep(make, {"d": [0.1, random.uniform(0.2, 0.4)]}, duration=5.0, realizations=64, rng=1)
    elif kind == 3:
        with il.simulate(own, 5.0, realizations=8, record=il.Trajectory(0.1), out=folder / "out.nc", rng=1) as result:
            result.displacement.values.sum()
    elif kind == 4:
        result = il.simulate(own, 5.0, realizations=8, record=[il.Density(bins=20), il.Trajectory(0.2)], rng=1)
        il.plot.trajectory(result)
        il.plot.density(result)
        plt.close("all")
    else:
        il.save(il.simulate(own, 5.0, realizations=8, rng=1), folder / "saved.nc")
        il.network_of(folder / "saved.nc").check()


def resident():
    """Return the memory that is in use (MB), where the system tells."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def left():
    """Return the numbers of open files and of threads."""
    return len(os.listdir("/proc/self/fd")), threading.active_count()


def main(seconds, seed=1):
    """Work for so long, tell each minute what is left, and return files and threads after a tenth and at the end."""
    matplotlib.use("Agg")
    warnings.simplefilter("ignore")
    random.seed(seed)
    begin, number, told, early = time.monotonic(), 0, 0.0, None
    with tempfile.TemporaryDirectory() as name:
        while (spent := time.monotonic() - begin) < seconds or number < 12:
            work(Path(name), number)
            number += 1
            if early is None and spent > 0.1 * seconds:
                early = left()
            if spent > told:
                told += 60.0
                files, threads = left()
                used = f"{resident():.1f} MB, {files} files, {threads} threads, CPU {time.process_time():.0f} s"
                print(f"{spent:.0f} s: {number} pieces of work, {used}", flush=True)
    print(f"end: {number} pieces of work, {resident():.1f} MB, {left()[0]} files, {left()[1]} threads")
    return early, left()


if __name__ == "__main__":
    main(float(sys.argv[1]), *map(int, sys.argv[2:]))
