"""Excitations as people write them: given forces, white noise that varies in time, tones with random phases."""

from __future__ import annotations

import math

import numpy as np

import impactlab as il


class TwoTones(il.Excitation):
    """Given force of two cosines."""

    amplitude: float = il.parameter(units="N")
    first: float = il.parameter(units="rad s-1", above=0.0)
    second: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def force(time, amplitude, first, second):  # type: ignore[no-untyped-def]
        return 0.5 * amplitude * (math.cos(first * time) + math.cos(second * time))


class SquareWave(il.Excitation):
    """Given force that changes its sign twice a period."""

    amplitude: float = il.parameter(units="N")
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def force(time, amplitude, frequency):  # type: ignore[no-untyped-def]
        return amplitude if math.sin(frequency * time) >= 0.0 else -amplitude


class Blasts(il.Excitation):
    """Given force that decays after each of equally distant blasts."""

    amplitude: float = il.parameter(units="N")
    interval: float = il.parameter(units="s", above=0.0)
    decay: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def force(time, amplitude, interval, decay):  # type: ignore[no-untyped-def]
        return amplitude * math.exp(-(time - interval * math.floor(time / interval)) / decay)


class PulsatingNoise(il.Excitation):
    """White noise of density ``level (1 + cos(frequency t))``."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def intensity(time, level, frequency):  # type: ignore[no-untyped-def]
        return level * (1.0 + math.cos(frequency * time))


class PulsedNoise(il.Excitation):
    """White noise of density ``level |sin(frequency t)|³``."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def intensity(time, level, frequency):  # type: ignore[no-untyped-def]
        return level * abs(math.sin(frequency * time)) ** 3


class Burst(il.Excitation):
    """White noise whose density rises and falls."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    frequency: float = il.parameter(units="rad s-1", above=0.0)

    @staticmethod
    def intensity(time, level, frequency):  # type: ignore[no-untyped-def]
        return level * math.sin(frequency * time) ** 2


class GustNoise(il.Excitation):
    """White noise with a gust: density ``level + peak exp(−((t − middle)/width)²)``."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    peak: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    middle: float = il.parameter(units="s")
    width: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def intensity(time, level, peak, middle, width):  # type: ignore[no-untyped-def]
        distance = (time - middle) / width
        return level + peak * math.exp(-distance * distance)


class FadingNoise(il.Excitation):
    """White noise that is switched on at 0 and fades."""

    level: float = il.parameter(units="N2 s rad-1", minimum=0.0)
    decay: float = il.parameter(units="s", above=0.0)

    @staticmethod
    def intensity(time, level, decay):  # type: ignore[no-untyped-def]
        return level * math.exp(-time / decay) if time > 0.0 else 0.0


class Tones(il.Excitation):
    """Sum of a few cosines of unequal distances with random phases."""

    amplitude: float = il.parameter(units="N")
    first: float = il.parameter(units="rad s-1", above=0.0)
    ratio: float = il.parameter(above=1.0)
    count: int = il.parameter(5, minimum=1)

    def lines(self) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies and amplitudes."""
        frequencies = self.first * self.ratio ** np.arange(self.count)
        return frequencies, np.full(self.count, self.amplitude / math.sqrt(self.count))
