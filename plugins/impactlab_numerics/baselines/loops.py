"""Baselines as a careful user writes them without impactlab: scalar loops of numba, and `solve_ivp`.

Every baseline is run batch by batch; a batch is long against the relaxation time (1.6 s), so that
batches count as independent.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from scipy.fft import irfft

import impactlab as il
from impactlab.compiling.jit import allocating
from impactlab_numerics.baselines import chains, pairs
from impactlab_numerics.scenes import Arrays, limits

SPIN_UP = 20.0
"""Time that is left out at the beginning (s), twelve relaxation times of the slowest body."""

SAMPLING = 0.02
"""Time between samples of the density (s)."""

BATCH = 100.0
"""Length of a batch (s), and the period of a series."""


class Batches(NamedTuple):
    """Batches of a run: means of the statistics and densities, (batch, statistic) and (batch, bin)."""

    values: np.ndarray
    densities: np.ndarray


@dataclass(eq=False)
class Loop:
    """A scalar loop of numba with NumPy's generator; `run` continues where the last call ended.

    Parameters
    ----------
    network : Network
        A scene.
    method : str
        Name of the loop: "baoab" or "euler_maruyama".
    step : float
        Step (s).
    bins : int
        Number of bins of the density.
    seed : int
    of_chains : bool
        Whether two bodies take the loop for chains, too.
    """

    network: il.Network
    method: str
    step: float
    bins: int
    seed: int
    of_chains: bool = field(default=False, kw_only=True)
    _state: Any = field(init=False)

    def __post_init__(self) -> None:
        count = len(self.network.oscillators)
        self.arrays = Arrays.of(self.network)
        self.generator = np.random.default_rng(self.seed)
        self._state = np.zeros((2, count))
        self._name, low, high = limits(self.network)
        self._bins = low, self.bins / (high - low)
        self.stride = max(1, round(SAMPLING / self.step))
        self.samples = round(BATCH / (self.stride * self.step))
        self.spin_up()

    def spin_up(self) -> None:
        """Run until the start is forgotten."""
        self._advance(round(SPIN_UP / (self.stride * self.step)), *self._sums())

    def _loop(self) -> Callable[..., None]:
        module = chains if self.of_chains or len(self.network.oscillators) > 2 else pairs
        return getattr(module, self.method)  # type: ignore[no-any-return]

    @property
    def batch(self) -> float:
        """Time of a batch (s)."""
        return self.samples * self.stride * self.step

    def run(self, batches: int) -> Batches:
        """Run a number of batches."""
        values, densities = [], []
        for _ in range(batches):
            sums = self._sums()
            self._advance(self.samples, *sums)
            value, density = self._means(self.samples * self.stride, *sums)
            values.append(value)
            densities.append(density)
        return Batches(np.array(values), np.array(densities))

    def _advance(self, samples: int, bodies: np.ndarray, contacts: np.ndarray, counts: np.ndarray) -> None:
        a = self.arrays
        noise = np.sqrt(np.pi * a.spectral_density / a.damping)
        self._loop()(
            self.generator, samples, self.stride, self.step, a.stiffness, a.damping, noise, a.hertz, a.clearance,
            *self._state, bodies, contacts, *self._bins, counts,
        )  # fmt: skip

    def _sums(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        count = len(self.network.oscillators)
        return np.zeros((3, count)), np.zeros((3, count - 1)), np.zeros(self.bins + 2, np.int64)

    def _means(
        self, steps: int, bodies: np.ndarray, contacts: np.ndarray, counts: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        value = np.array([bodies[1, -1], contacts[0, -1], contacts[1, -1]]) / steps
        return value, counts[1:-1] * (self._bins[1] / counts.sum())


@dataclass(eq=False)
class SeriesLoop(Loop):
    """Runge-Kutta under a sum of cosines from one inverse FFT, as the paper has it.

    A batch is one series with phases of its own, over one period; its last part, repeated in
    front, is the spin-up.

    Parameters
    ----------
    components : int
        Number of cosines.
    band : tuple of float
        Frequencies (Hz).
    """

    components: int = 50000
    band: tuple[float, ...] = (0.0, 500.0)
    _series: np.ndarray = field(init=False, default_factory=lambda: np.empty(0))

    def spin_up(self) -> None:
        """Nothing: every batch has its own."""

    def run(self, batches: int) -> Batches:
        """Run a number of batches."""
        results = [self._one() for _ in range(batches)]
        return Batches(np.array([value for value, _ in results]), np.array([density for _, density in results]))

    def _one(self) -> tuple[np.ndarray, np.ndarray]:
        a, period = self.arrays, self.components / (self.band[1] - self.band[0])
        count, lead = 2 * round(period / self.step), 2 * round(SPIN_UP / self.step)
        if self._series.size == 0:
            self._series = np.empty((len(a.stiffness), lead + count + 1))
        series = self._series
        for row, density in enumerate(a.spectral_density):
            spectrum = np.zeros(count // 2 + 1, complex)
            first = round(self.band[0] * period) + 1
            # one-sided density per hertz S_f = 4π S, amplitude of a cosine sqrt(2 S_f Δf)
            amplitude = math.sqrt(8.0 * math.pi * density / period)
            cosines(self.generator, 0.5 * count * amplitude, spectrum[first : first + self.components])
            series[row, lead:-1] = irfft(spectrum, count, overwrite_x=True)
        series[:, :lead], series[:, -1] = series[:, -1 - lead : -1], series[:, lead]
        self._state[:] = 0.0
        advance: Any = self._loop()
        results: Any = None
        for begin, end in ((0, lead), (lead, lead + count)):
            results = self._sums()
            advance(
                series, begin, (end - begin) // (2 * self.stride), self.stride, self.step, a.stiffness, a.damping,
                a.hertz, a.clearance, *self._state, results[0], results[1], *self._bins, results[2],
            )  # fmt: skip
        return self._means(count // 2, *results)


def series_loop(
    network: il.Network, step: float, bins: int, seed: int, components: int, band: tuple[float, ...]
) -> SeriesLoop:
    """Return the loop for a band of noise; parameters as of `SeriesLoop`.

    Simpson's rule, which Runge-Kutta is for a force, takes the frequency 1/step for a constant one: there
    are no cosines above half of it.
    """
    low, high = band
    top = min(high, 0.5 / step)
    lines = round(components * (top - low) / (high - low))
    return SeriesLoop(network, "runge_kutta", step, bins, seed, components=lines, band=(low, top))


@allocating
def cosines(generator, amplitude, spectrum):  # type: ignore[no-untyped-def]
    """Fill a spectrum with one amplitude and random phases."""
    for line in range(spectrum.shape[0]):
        phase = 2.0 * math.pi * generator.random()
        spectrum[line] = complex(amplitude * math.cos(phase), amplitude * math.sin(phase))


def in_parallel(make: Callable[[int], Loop], batches: int, workers: int) -> Batches:
    """Run batches on several threads, each with a loop of its own; `make` takes the number of one."""
    share = -(-batches // workers)
    with ThreadPoolExecutor(workers) as pool:
        parts = list(pool.map(lambda number: make(number).run(share), range(workers)))
    return Batches(*(np.concatenate(items) for items in zip(*parts, strict=True)))


def solve_ivp_rate(network: il.Network, duration: float, seed: int) -> float:
    """Return the seconds that `scipy.integrate.solve_ivp` takes for a second of a scene.

    The network's right-hand side with white noise up to 500 Hz as a series, the contacts as
    events, and steps of at most 1 ms, so that neither is missed.
    """
    from scipy.integrate import solve_ivp

    system, a = network.compile(), Arrays.of(network)
    count, bodies = round(duration / 0.001) + 1, len(a.stiffness)
    noise = np.random.default_rng(seed).standard_normal((count, bodies))
    noise *= np.sqrt(2.0 * np.pi * a.spectral_density / 0.001)

    def rhs(t: float, y: np.ndarray) -> np.ndarray:
        slope = system.rhs(t, y)
        place = min(int(t * 1000.0), count - 2)
        part = t * 1000.0 - place
        slope[bodies:] += (1.0 - part) * noise[place] + part * noise[place + 1]
        return slope

    begin = time.perf_counter()
    solution = solve_ivp(
        rhs, (0.0, duration), np.zeros(2 * bodies), method="RK45", rtol=1e-6, atol=1e-9, max_step=0.001,
        events=system.contact_events,
    )  # fmt: skip
    if not solution.success:
        raise il.ImpactLabError(f"solve_ivp failed: {solution.message}")
    return (time.perf_counter() - begin) / duration
