"""The methods that are compared, and the findings of one run."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

import impactlab as il
from impactlab_numerics.scenes import STATISTICS, Law

if TYPE_CHECKING:
    import xarray as xr

    from impactlab_numerics.baselines.loops import Batches

SIGMAS = np.array([2.0, 2.0, 2.0, 1.0])
"""Standard errors that count as error, as in a tolerance; the noise of a density is summed over the bins already."""


SEEN = 2.0
"""Standard errors from which a bias counts as seen."""


@dataclass(frozen=True)
class Method:
    """A scheme at a step in a scene.

    Attributes
    ----------
    scene : str
        "base case" or "chain".
    tool : str
        What runs it: "impactlab", "numba", or the name of another library.
    scheme : str
        Such as "exact flow" or "BAOAB".
    noise : str
        "white" or "series", a sum of cosines.
    step : float
        Step (s); 0 for the automatic one.
    """

    scene: str
    tool: str
    scheme: str
    noise: str
    step: float

    @property
    def key(self) -> str:
        """A name that is also one of a file."""
        step = f"{1000.0 * self.step:g} ms" if self.step else "automatic"
        return f"{self.scene}, {self.tool}, {self.scheme}, {self.noise}, {step}"

    @property
    def line(self) -> str:
        """Name of the line in a diagram: methods that differ in the step only share it."""
        return f"{self.tool}: {self.scheme}" + (", series" if self.noise == "series" else "")


@dataclass(eq=False)
class Findings:
    """What is known of a method; arrays are along `STATISTICS`.

    Attributes
    ----------
    bias, bias_error : ndarray
        Relative difference from the exact value, and its standard error; of the density the
        probability that is elsewhere, ½∫|p − q|, beyond what noise alone would give.
    scatter : ndarray
        Square of the relative standard error, times the simulated time (s); of the density the
        square of what noise alone would give.
    direct_scatter : ndarray
        The same without balances.
    step : float
        Step (s).
    rate : float
        Seconds of computing for a second of one realization.
    startup : float
        Seconds before the statistics begin.
    spin_up : float
        Time that is left out at the beginning (s).
    note : str
        What else is to be said.
    rates : list of float
        Rates of all rounds.
    """

    bias: np.ndarray
    bias_error: np.ndarray
    scatter: np.ndarray
    direct_scatter: np.ndarray
    step: float
    rate: float = np.nan
    startup: float = 0.0
    spin_up: float = 0.0
    note: str = ""
    rates: list[float] = field(default_factory=list)


def unknown(step: float, note: str, scatter: np.ndarray | None = None) -> Findings:
    """Return findings of a method whose bias is not known; 0 is assumed, in its favour."""
    nothing = np.full(len(STATISTICS), np.nan)
    scatter = nothing if scatter is None else scatter
    return Findings(nothing, nothing, scatter, scatter, step, note=note)


def of_dataset(result: xr.Dataset, law: Law) -> Findings:
    """Judge a result of `simulate` with a density."""
    time = result.attrs["duration"] * result.attrs["realizations"]
    values, errors, direct = (
        np.array([float(result[f"{prefix}{name}{ending}"][-1]) for name in STATISTICS[:-1]])
        for prefix, ending in (("", ""), ("", "_standard_error"), (_direct(result), "_standard_error"))
    )
    density = result["density_displacement"].values[-1]
    noise = result["density_displacement_standard_error"].values[-1]
    found = _findings(law, values, errors, density, noise, time, result.attrs["step"])
    found.spin_up = result.attrs["spin_up"]
    found.direct_scatter = np.append((direct / law.values) ** 2 * time, found.scatter[-1])
    return found


def of_batches(batches: Batches, batch: float, law: Law, step: float) -> Findings:
    """Judge batches of a given length (s), which count as independent."""
    count = len(batches.values)
    values, density = batches.values.mean(axis=0), batches.densities.mean(axis=0)
    errors, noise = (item.std(axis=0, ddof=1) / np.sqrt(count) for item in batches)
    return _findings(law, values, errors, density, noise, count * batch, step)


def _direct(result: xr.Dataset) -> str:
    return "direct_" if f"direct_{STATISTICS[0]}" in result else ""


def _findings(
    law: Law, values: np.ndarray, errors: np.ndarray, density: np.ndarray, noise: np.ndarray, time: float, step: float
) -> Findings:
    width, noise = np.diff(law.edges), np.nan_to_num(noise)
    elsewhere = 0.5 * np.abs(density - law.density) @ width
    expected = 0.5 * np.sqrt(2.0 / np.pi) * noise @ width  # of the absolute value of a normal variable
    spread = 0.5 * np.sqrt(1.0 - 2.0 / np.pi) * np.sqrt((noise * width) @ (noise * width))
    bias = np.append(values / law.values - 1.0, max(elsewhere - expected, 0.0))
    scatter = np.append(errors / law.values, expected) ** 2 * time
    return Findings(bias, np.append(errors / law.values, spread), scatter, scatter, step)


def seconds_to(accuracy: Any, found: Findings, *, direct: bool = False, deviations: float | None = None) -> np.ndarray:
    """Return the time that a method needs until |bias| + 2 standard errors are within an accuracy.

    The standard error falls as one over the square root of the time, so that the time is
    ``startup + rate scatter (2/(accuracy − |bias|))²``, and infinite where the bias alone is
    too large. The bias that is measured has an error of its own. By default a bias within two
    standard errors counts as 0, in favour of the method: the time is then a lower bound. Else
    the bias is made larger by some of its standard errors, or smaller, down to 0.

    Parameters
    ----------
    accuracy : float
        Relative accuracy.
    found : Findings
    direct : bool
        Whether without balances.
    deviations : float, optional
        Standard errors by which the bias is made larger, or smaller if negative.
    """
    bias, error = np.nan_to_num(np.abs(found.bias)), np.nan_to_num(found.bias_error)
    taken = np.where(bias > SEEN * error, bias, 0.0) if deviations is None else bias + deviations * error
    room = accuracy - np.maximum(taken, 0.0)
    scatter = found.direct_scatter if direct else found.scatter
    with np.errstate(divide="ignore"):
        needed = found.startup + found.rate * scatter * (SIGMAS / room) ** 2
    return np.where(room > 0.0, needed, np.inf)


def integrator(scheme: str) -> il.Integrator:
    """Return the integrator of a scheme of impactlab."""
    from impactlab_numerics.work_precision.variants import PlainKick, TwoNormals

    kinds: dict[str, type[il.Integrator]] = {
        "exact flow": il.ExactFlow,
        "exact flow, plain kick": PlainKick,
        "exact flow, two normals": TwoNormals,
        "Runge–Kutta": il.RungeKutta4,
        "Euler–Maruyama": il.EulerMaruyama,
    }
    kind = kinds[scheme]
    return kind(measured=False) if issubclass(kind, il.ExactFlow) else kind()
