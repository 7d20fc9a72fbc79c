"""Run times, measured fairly: warm, on one core, in rounds in which every method has its turn."""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import impactlab as il
from impactlab.machine import SharedThreads

SHORT = 500
"""Steps of the shorter of two runs, of which the difference gives the rate."""

ATTEMPTS = 10
"""How often a measurement is tried."""

Measurement = tuple[float, float]
"""Seconds of computing for a second of one realization, and seconds before the statistics begin."""


@dataclass(eq=False)
class Ensemble:
    """Times `simulate` at two lengths: the difference gives the rate, the remainder the time before the steps.

    Parameters
    ----------
    network : Network
    options : dict
        Options of `simulate` but duration, spin-up, seed and executor.
    step : float
        Step (s).
    spin_up : float
        Spin-up that belongs to the seconds before the statistics begin (s).
    seconds : float
        Least time between the two runs (s).
    threads : int
    """

    network: il.Network
    options: dict[str, Any]
    step: float
    spin_up: float
    seconds: float
    threads: int = 1

    def __post_init__(self) -> None:
        self.pool = ThreadPoolExecutor(self.threads)
        self.short = SHORT * self.step
        self.run(self.short)  # compiles
        spent, self.long = self.run(self.short), 4.0 * self.short
        while self.run(self.long) < self.seconds + spent:
            self.long *= 2.0

    def run(self, duration: float) -> float:
        """Return the seconds of one run."""
        begin = time.perf_counter()
        il.simulate(self.network, duration, **self.options, spin_up=0.0, rng=1, executor=self.pool, progress=False)
        return time.perf_counter() - begin

    def __call__(self) -> Measurement:
        for _ in range(ATTEMPTS):  # on a busy machine the longer run may be the quicker one
            short, longer = self.run(self.short), self.run(self.long)
            rate = (longer - short) / (self.long - self.short)
            if rate > 0.0:
                break
        else:
            raise il.ImpactLabError("This machine is too busy to measure run times.")
        startup = max(short - rate * self.short, 0.0) + rate * self.spin_up
        return rate / self.options.get("realizations", 1), startup


@dataclass(eq=False)
class Whole:
    """Times a call that simulates a few seconds; the first call, which is not counted, compiles.

    Parameters
    ----------
    call : callable
        Takes how many batches it is to make.
    batch : float
        Seconds that a batch simulates.
    seconds : float
        Least time of a measurement (s).
    clock : callable
        `time.process_time` where a library uses more cores than it is told to: the time of all
        cores is as good as that of one.
    """

    call: Callable[[int], Any]
    batch: float
    seconds: float
    clock: Callable[[], float] = time.perf_counter

    def __post_init__(self) -> None:
        self.call(1)
        self.batches = 1
        while self._seconds(self.batches) < self.seconds:
            self.batches *= 2

    def _seconds(self, batches: int) -> float:
        begin = self.clock()
        self.call(batches)
        return self.clock() - begin

    def __call__(self) -> Measurement:
        return self._seconds(self.batches) / (self.batches * self.batch), 0.0


class Stopwatch(SharedThreads):
    """Runs blocks one after another where it is called, and takes the time that they need.

    Attributes
    ----------
    seconds : float
        Time of the processor that blocks have taken (s): on a busy machine it is less disturbed
        than the time on the clock.
    """

    def __init__(self) -> None:
        super().__init__(1, 1)
        self.seconds = 0.0

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a block."""
        future: Future[Any] = Future()
        begin = time.process_time()
        future.set_result(call(*args, **kwargs))
        self.seconds += time.process_time() - begin
        return future


class Tracer(Stopwatch):
    """Traces the memory from the first block on, without that of planning."""

    def submit(self, call: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run a block."""
        if not tracemalloc.is_tracing():
            tracemalloc.start()
        return super().submit(call, *args, **kwargs)


def peak_memory(network: il.Network, duration: float, **options: Any) -> int:
    """Return the peak memory while a simulation runs blocks and makes its result (bytes)."""
    try:
        il.simulate(network, duration, **options, rng=1, executor=Tracer(), progress=False)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@dataclass(eq=False)
class Blocks:
    """Times the steps of an ensemble on one core, without start and spin-up, planning and estimates.

    Parameters
    ----------
    network : Network
    options : dict
        Options of `simulate` but duration, seed and executor.
    seconds : float
        Least time of a measurement (s), about.
    short : float
        Duration (s) of a run whose time is taken off.
    """

    network: il.Network
    options: dict[str, Any]
    seconds: float
    short: float

    def __post_init__(self) -> None:
        self.run(self.short)  # compiles
        self.begin, self.skipped = self.run(self.short), self.result.attrs["duration"]
        self.duration = 4.0 * self.short
        while (spent := self.run(self.duration) - self.begin) < 0.5 * self.seconds:
            self.duration *= min(max(self.seconds / max(spent, 1e-9), 2.0), 100.0)

    def run(self, duration: float) -> float:
        """Return the seconds that the blocks take; `result` is the dataset, `rest` the seconds around them."""
        watch, begin = Stopwatch(), time.process_time()
        self.result = il.simulate(self.network, duration, **self.options, rng=1, executor=watch, progress=False)
        self.rest = time.process_time() - begin - watch.seconds
        return watch.seconds

    def __call__(self) -> Measurement:
        spent = self.run(self.duration) - self.begin
        return spent / (self.result.attrs["duration"] - self.skipped) / self.options.get("realizations", 1), self.rest


def in_rounds(timers: Mapping[Any, Callable[[], Measurement]], rounds: int) -> dict[Any, list[Measurement]]:
    """Let every timer measure once in each round."""
    found: dict[Any, list[Measurement]] = {key: [] for key in timers}
    for _ in range(rounds):
        for key, timer in timers.items():
            found[key].append(timer())
    return found
