"""Records of spectral densities, by Welch's method."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.errors import InvalidInput, warn
from impactlab.inputs import suggestion
from impactlab.linear.decay import relaxation_time
from impactlab.plan.plan import Plan
from impactlab.records.record import Keeper, Record, names_of
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, labelled, with_error
from impactlab.results.snapshot import ALL, places_of, with_points
from impactlab.statistics.subsamples import OF_BAND, in_subsamples, mean_of_subsamples

SEGMENT = 20.0
"""Length of a segment in relaxation times of the slowest body, so that resonances are resolved."""

_SHARE = with_points({"displacement": 0.5, "velocity": 0.125, "contact_force": 0.0})
"""Interval between samples over the time scale 1/ω of the fastest body."""

_POWER = with_points({"displacement": 4, "velocity": 2, "contact_force": 2})
"""Powers of the frequency with which spectra fall, under white noise; where kicks are forces, those jump at most."""

FOLDED, HIGHEST = 0.1, 0.02
"""Part of what is folded back that is uncertain; part of the frequencies, the highest, from which it is estimated."""

BEYOND = 0.05
"""Part of the variance beyond the highest frequency from which on there is a warning."""

_UNITS = with_points({"displacement": "m2 s rad-1", "velocity": "m2 s-1 rad-1", "contact_force": "N2 s rad-1"})


class Spectrum(Record):
    """Spectral density of a displacement or a velocity, of bodies or of points of structures, or of a contact force.

    It is two-sided over angular frequency, as that of `WhiteNoise`: its integral over all frequencies, negative ones
    too, is the variance. Segments with Hann's window overlap by half (Welch 1967); what they resolve is
    4π over their length. Standard errors come from subsamples of realizations, as for densities, with a factor for a
    band around the whole curve. Samples contain what is faster than half their rate as well, folded back: it is
    estimated from what there is at that rate, for spectra that fall like powers, and subtracted; a tenth of it is a
    part of the error. Its share of the variance, which the spectrum does not show, is returned as well; where that is
    more than 5 % there is a warning.

    Parameters
    ----------
    quantity : str
        "displacement", "velocity" or "contact_force"; "point_displacement" or "point_velocity" at points.
    labels : sequence of str, optional
        Bodies, contacts or points; all by default.
    segment : float, optional
        Length of the segments (s); by default 20 relaxation times of the slowest body, at most the duration.
    interval : float, optional
        Time between samples (s); by default 1/2ω of the fastest body for displacements and 1/8ω for velocities, but
        where forces kick at least one step, and one step for contact forces.

    Examples
    --------
    >>> result = il.simulate(network, 40.0, realizations=64, record=il.Spectrum(segment=10.0), rng=1)
    >>> result.spectrum_displacement.dims
    ('oscillator', 'displacement_frequency')
    """

    citation = article(
        "Welch, P. D.",
        "The use of fast Fourier transform for the estimation of power spectra: a method based on time averaging "
        "over short, modified periodograms",
        "IEEE Trans. Audio Electroacoust.", 15, 1967, "70", "10.1109/TAU.1967.1161901",
    )  # fmt: skip

    quantity: str = parameter("displacement")
    labels: tuple[str, ...] | None = parameter(None, kw_only=True)
    segment: float | None = parameter(None, units="s", above=0.0)
    interval: float | None = parameter(None, units="s", above=0.0)

    every_step: ClassVar[bool] = True

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.quantity not in _UNITS:
            raise InvalidInput(f"Spectrum.quantity: {suggestion(self.quantity, _UNITS)}")

    @property
    def identity(self) -> tuple[str, ...]:
        return type(self).__name__, self.quantity

    def resolved(self, model: Model) -> Record:
        names = names_of(self, "label", self.labels, self.quantity, model)
        segment = self.segment or SEGMENT * relaxation_time(model)
        if not segment > 0.0:
            raise InvalidInput("Spectrum: no segment can be chosen, since nothing is damped; give segment= (s).")
        return self.replace(labels=names, segment=segment)

    def exact_interval(self) -> float | None:
        return self.interval

    def stride(self, model: Model, step: float) -> int:
        if self.interval is not None:
            return round(self.interval / step)
        fastest = float(np.sqrt(model.stiffness / model.mass).max())
        return max(1, int(_SHARE[self.quantity] / (fastest * step))) if fastest > 0.0 else 1

    def longest_step(self, model: Model) -> float:
        fastest, share = float(np.sqrt(model.stiffness / model.mass).max()), _SHARE[self.quantity]
        return share / fastest if self.interval is None and share * fastest > 0.0 else math.inf

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Segments(self, run.plan, realizations, ratio)

    def samples_per_segment(self, plan: Plan, interval: float) -> int:
        """Return the even number of samples in a segment, at most those of the run."""
        assert self.segment is not None
        longest = int(plan.clock.steps * plan.clock.step / interval * (1.0 + 1e-9))
        count = min(round(self.segment / interval), longest) // 2 * 2
        if count < 8:
            raise InvalidInput(
                f"Spectrum: a segment has {count} samples, {interval:g} s apart, but needs at least 8. Run for "
                "longer, or give a longer segment= or a shorter interval= (s)."
            )
        return count

    def bytes_per_realization(self, run: RecordedRun, interval: float) -> int:
        plan = run.plan
        count = self.samples_per_segment(plan, interval)
        return 8 * len(self.labels or ()) * (count + plan.samples_per_realization * (count // 2 + 1))

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        plan = run.plan
        q, known = self.quantity, plan.snapshot.names(self.quantity)
        dimension = ALL[q].dimension
        if not known:
            return {}
        keys = "power", "mean", "segments"
        power, mean, segments = (in_subsamples([item[key] for item in results]) for key in keys)
        count = self.samples_per_segment(plan, interval)
        window = _window(count)
        frequencies = 2.0 * math.pi * np.arange(count // 2 + 1) / (count * (self.interval or interval))
        scale = interval / (2.0 * math.pi * (window**2).sum())
        of_mean = np.abs(np.fft.rfft(window)) ** 2  # what a constant gives: only at the lowest two frequencies
        density, error = np.full((2, len(known), len(frequencies)), np.nan)
        factor, beyond = np.full((2, len(known)), np.nan)
        assert self.labels is not None
        places = places_of(known)
        for row, name in enumerate(self.labels):
            slot = places[name]
            estimated = mean_of_subsamples(power[:, row], segments[:, None], plan.realizations.trusted, slice(None))
            value, scatter, factor[slot] = estimated
            constant = mean[:, row].sum() / (segments.sum() * count)
            density[slot] = scale * (value - constant**2 * of_mean)
            folded = _folded(density[slot], _POWER[q])
            total = float(density[slot].sum())
            beyond[slot] = float(folded.sum()) / total if total > 0.0 else 0.0
            density[slot], error[slot] = density[slot] - folded, np.hypot(scale * scatter, FOLDED * folded)
        self._warn_of_beyond(known, beyond, float(frequencies[-1]), interval)
        dims = (dimension, f"{q}_frequency")
        text = f"two-sided spectral density of the {ALL[q].long_name} over angular frequency"
        return {
            **with_error(f"spectrum_{q}", dims, density, error, _UNITS[q], text),
            f"spectrum_{q}_band_factor": ((dimension,), factor, OF_BAND),
            f"spectrum_{q}_beyond": labelled((dimension,), beyond, "1", "part of the variance beyond the frequencies"),
            f"{q}_frequency": labelled((f"{q}_frequency",), frequencies, "rad s-1", "angular frequency"),
        }

    def _warn_of_beyond(self, names: Sequence[str], beyond: np.ndarray, highest: float, interval: float) -> None:
        """Warn if much of a variance is at higher frequencies than the spectrum shows."""
        most = int(np.nanargmax(beyond))
        if beyond[most] > BEYOND:
            part, name = f"{100.0 * beyond[most]:.2g} % of the variance", ALL[self.quantity].long_name
            warn(
                "beyond_spectrum",
                f"{part} of the {name} of {names[most]!r} is at frequencies beyond those of its Spectrum, up to "
                f"{highest:.3g} rad/s; give interval={interval * BEYOND / beyond[most]:.2g} (s) or less.",
            )


def _folded(density: np.ndarray, power: int) -> np.ndarray:
    """Return what samples fold back onto frequencies from 0 to half their rate, of a spectrum that falls like a power.

    All that lie on a frequency ω add up to a sum over ``|ω + k ω_s|^-p``; its own term apart they are folded.
    """
    x = 0.5 * np.pi * np.arange(1, len(density)) / (len(density) - 1)
    every = 1.0 / np.sin(x) ** 2
    if power == 4:
        every = every**2 - every / 1.5
    folded = np.concatenate([[1.0 / 3.0 if power == 2 else 1.0 / 45.0], every - x**-power])  # of the pairs ±k at 0
    count = max(1, math.ceil(HIGHEST * len(x)))
    return np.asarray(folded * max(float(np.mean(density[-count:] / every[-count:])), 0.0))


def _window(count: int) -> np.ndarray:
    """Hann's window, periodic."""
    result: np.ndarray = 0.5 - 0.5 * np.cos(2.0 * math.pi * np.arange(count) / count)
    return result


class _Segments(Keeper):
    def __init__(self, record: Spectrum, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        assert record.labels is not None
        super().__init__(ratio)
        self.reader, self.filled = plan.snapshot.reader(record.quantity, record.labels), 0
        rows = len(record.labels)
        self.count = record.samples_per_segment(plan, plan.interval(ratio))
        self.window = _window(self.count)
        self.parts, lanes = plan.samples_per_realization, len(realizations)
        self.buffer = np.empty((rows, lanes, self.count))
        self.power = np.zeros((lanes, self.parts, rows, self.count // 2 + 1))
        self.mean, self.segments = np.zeros((lanes, self.parts, rows)), np.zeros((lanes, self.parts))

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own = self.reader(self.own(snapshots))
        while len(own):
            taken = min(len(own), self.count - self.filled)
            self.buffer[:, :, self.filled : self.filled + taken] = own[:taken, self.reader.rows].transpose(1, 2, 0)
            own, self.filled = own[taken:], self.filled + taken
            if self.filled == self.count:
                self._transform(min(batch, self.parts - 1))
                self.filled = self.count // 2
                self.buffer[:, :, : self.filled] = self.buffer[:, :, self.filled :]

    def _transform(self, part: int) -> None:
        """Add the squared amplitudes of the segment, to the batch in which it ends."""
        self.segments[:, part] += 1.0
        for row, of_row in enumerate(self.buffer):
            for lane, series in enumerate(of_row):
                self.power[lane, part, row] += np.abs(np.fft.rfft(self.window * series)) ** 2
                self.mean[lane, part, row] += series.sum()

    def result(self) -> dict[str, np.ndarray]:
        return {"power": self.power, "mean": self.mean, "segments": self.segments}
