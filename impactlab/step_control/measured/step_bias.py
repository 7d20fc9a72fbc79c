"""The bias of a step in each statistic, as measured on the network, and its consequences."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from impactlab.errors import WORTH_SAYING
from impactlab.results.labels import Variables, labelled
from impactlab.results.losses import LOSSES
from impactlab.results.schema import BODY, CONTACT, EVERY, OF_STATES, STATE
from impactlab.step_control.measured.bias import (
    TOLERATED,
    USUAL_BIAS,
    Bias,
    margin_of,
    size_of,
    tolerated,
)

if TYPE_CHECKING:
    import xarray as xr

FARTHEST = 10.0
"""Times the automatic step from which on biases are not expected to grow: hardly any larger step is let through."""

UNLIKE = 2.0
"""Ratio of the mean square velocity of a run to its measurement beyond which the measurement is not of the run."""

REPRESENTATIVE = {"mean_square_displacement", "mean_square_velocity", "contact_rate", "mean_contact_force"}
"""Statistics of a measurement that represent the run."""

LIKE = 0.25
"""Relative difference of mean square velocities up to which a measurement represents the run."""

UNSURE = 6.0 * WORTH_SAYING
"""Bias that must be excluded, beside three standard errors of the run, where motion is not stationary; at a third of it
ten of 75 networks raised a warning, and no value was off."""

REACHED = 0.95
"""Share of a run that is not stationary up to which a measurement must reach."""

KNOWN = 0.1
"""Three relative standard errors of a statistic up to which a warning names its bias as unknown."""

HEAVY = 2.0
"""Factor of standard errors along chaotic paths: few long flights make their tails heavier than normal ones."""

UNKNOWN_AVERAGE = 2.0 * WORTH_SAYING
"""Relative scatter of an average along a chaotic path from which on there is a warning."""

UNIMPROVED = 0.8
"""Part of the bias of a state that remains at half the step from which on a smaller step does not help."""

BIASED = (
    "mean_displacement",
    "mean_square_displacement",
    "variance_displacement",
    "mean_square_velocity",
    "contact_ratio",
    "contact_rate",
    "mean_contact_force",
)
"""Statistics of bodies and contacts whose bias is measured, beside all of states of laws."""

GROWTH = "law_state_growth_rate"
"""Statistic whose bias is a part of the mean rate of all changes where it may be 0."""


@dataclass(frozen=True, eq=False)
class StepBias:
    """Bias of a step in each statistic, as measured.

    Attributes
    ----------
    step : float
        The step (s).
    bias : dict of str to Bias
        By the name of the statistic, as a part of its size.
    labels : dict of str to tuple of str
        Names of bodies and contacts by dimension.
    measured : dict of str to (body or contact,) ndarray
        Statistics at the step, as measured on the way.
    scatter : (body,) ndarray
        Standard error of the measured mean square velocity.
    reached : float
        Share of the run that is over where the measurement ends.
    error_of_order : float
        Part of a bias that is unsure, since it may fall with another power of the step than is expected.
    growth : (state,) ndarray
        Size of growth rates of states.
    order : float
        Power of the step with which biases are taken to fall.
    seen_at : float
        Larger step at which they were measured (s), if it is another.
    """

    step: float
    bias: dict[str, Bias]
    labels: dict[str, tuple[str, ...]]
    measured: dict[str, np.ndarray] = field(default_factory=dict)
    scatter: np.ndarray | float = 0.0
    reached: float = 1.0
    error_of_order: float = 0.0
    growth: np.ndarray = field(default_factory=lambda: np.zeros(0))
    order: float = 2.0
    seen_at: float = 0.0

    @property
    def foreseen(self) -> bool:
        """Whether it follows from a measurement at another step."""
        return self.seen_at > self.step

    @classmethod
    def infinite(cls, step: float, bodies: tuple[str, ...], contacts: tuple[str, ...]) -> Self:
        """Return the bias of a step at which the motion leaves the range of finite numbers."""
        name, endless = "mean_square_velocity", np.full(len(bodies), np.inf)
        bias = {name: Bias(endless, np.zeros(len(bodies)))}
        return cls(step, bias, {BODY: bodies, CONTACT: contacts}, {name: endless})

    @property
    def margin(self) -> float:
        """Errors within which biases are not known."""
        return margin_of(sum(len(bias.value) for bias in self.bias.values()))

    @property
    def worst(self) -> tuple[str, str, float, float]:
        """The statistic whose bias is most certainly large: name, label, bias and its error."""
        return self._worst(lambda name: 1.0)

    def _worst(self, size: Callable[[str], float]) -> tuple[str, str, float, float]:
        """Return the same where biases count as parts of some size."""
        found, beyond, margin = ("", "", 0.0, 0.0), 0.0, self.margin
        for name, bias in self.bias.items():
            excess = bias.least(margin) / size(name)
            if excess.max(initial=beyond) > beyond:
                place = int(excess.argmax())
                label = self.labels[EVERY[name].dimension][place]
                found, beyond = (name, label, float(bias.value[place]), float(bias.error[place])), excess[place]
        return found

    @property
    def certain(self) -> float:
        """Largest bias of any statistic, without what may be chance."""
        _, _, bias, error = self.worst
        return max(abs(bias) - self.margin * error, 0.0)

    @property
    def does(self) -> bool:
        """Whether no bias is certainly too large."""
        name, _, bias, error = self._worst(tolerated)
        return not name or abs(bias) - self.margin * error <= tolerated(name)

    @property
    def surely_small(self) -> bool:
        """Whether all biases are surely small enough."""
        return all((bias.most(self.margin) <= tolerated(name)).all() for name, bias in self.bias.items())

    def unclear(self, time: float) -> bool:
        """Whether a bias may be worth saying, beside the standard error that so many closings in some time (s) leave.

        Those of bodies are not counted on: balances may make them as small as they like.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            rates = self.measured.get("contact_rate", np.zeros(0))
            of_contacts = np.nan_to_num(1.0 / np.sqrt(time * rates), nan=np.inf)
        beside = {BODY: np.zeros(1), CONTACT: of_contacts, STATE: np.zeros(1)}
        for name, bias in self.bias.items():
            largest = np.where(np.isfinite(bias.error), bias.most(self.margin), 0.0)
            if (largest > WORTH_SAYING + beside[EVERY[name].dimension]).any():
                return True
        return False

    @property
    def better(self) -> float:
        """A step at which the bias is small enough, if the bias falls with the square of the step (s)."""
        name, _, bias, _ = self._worst(tolerated)
        if not name or abs(bias) <= tolerated(name):
            return self.step
        return self.step * max(0.25, 0.8 * math.sqrt(tolerated(name) / abs(bias)))

    def follows_the_step(self, before: StepBias) -> bool:
        """Whether a state is as far off as it was at a step twice as large or more, as a count of steps is."""
        (name, label, bias, _), (*other, bias_before, _) = (item._worst(tolerated) for item in (self, before))
        halved = self.step <= 0.5 * before.step
        return name in OF_STATES and [name, label] == other and halved and abs(bias) > UNIMPROVED * abs(bias_before)

    def scattered(self, found: StepBias, apart: dict[str, np.ndarray]) -> StepBias:
        """Return these biases with the errors of others where paths are apart."""
        bias = {
            name: own._replace(
                error=np.where(apart[name], HEAVY * found.bias[name].error, own.error), apart=apart[name]
            )
            for name, own in self.bias.items()
        }
        return replace(self, bias=bias)

    def told(self) -> StepBias:
        """Return these biases with what the compared paths cannot tell in their errors."""
        return replace(self, bias={name: bias.told() for name, bias in self.bias.items()})

    def with_order(self) -> StepBias:
        """Return these biases with errors that allow for another power of the step; none is less certain for that."""
        bias = {name: bias.with_order(self.error_of_order) for name, bias in self.bias.items()}
        return replace(self, bias=bias, error_of_order=0.0)

    @property
    def wandering(self) -> str:
        """Say how well averages along paths are known that are apart; nothing where no path is, or they are known."""
        known = {
            name: np.where(bias.apart & np.isfinite(bias.error), bias.error, 0.0) / (math.sqrt(2.0) * HEAVY)
            for name, bias in self.bias.items()
        }
        name = max(known, key=lambda name: known[name].max(initial=0.0), default="")
        if not name or known[name].max(initial=0.0) <= UNKNOWN_AVERAGE:
            return ""
        place = int(known[name].argmax())
        label = self.labels[EVERY[name].dimension][place]
        return (
            f"Averages along this path are known to ± {100.0 * known[name][place]:.2g} % only "
            f"({EVERY[name].long_name} of {label!r}): small errors change it as they change chaotic paths, at "
            "any step. Run for longer, or use realizations with different initial= values."
        )

    def at(self, step: float) -> StepBias:
        """Return the bias extrapolated to a smaller step (s): it falls with a power of the step, from 1 to `order`.

        The value assumes `order`; the difference from the first power counts as a standard error.
        """
        bias = {name: bias.at(step / self.step, self.order) for name, bias in self.bias.items()}
        return replace(self, step=step, bias=bias, seen_at=max(self.step, self.seen_at))

    def allowance(self, name: str, usual: float = USUAL_BIAS) -> np.ndarray:
        """Return the allowance for the bias of a statistic where biases are `usual`; more of states is tolerated."""
        return self.bias[name].allowance(usual * (tolerated(name) / TOLERATED), self.margin)

    def usual(self, automatic: float) -> float:
        """Return the standard deviation of biases that is to be expected, from the step that rules allow (s)."""
        return USUAL_BIAS * min(max(1.0, self.step / max(automatic, 1e-300)), FARTHEST) ** 2

    def will_do(self, automatic: float) -> bool:
        """Whether no bias is too large, nor may well be; where one was not seen, the rules know best."""
        if self.step > automatic * (1.0 + 1e-9) and not all(
            np.isfinite(item.error).all() for item in self.bias.values()
        ):
            return False
        usual = self.usual(automatic)
        return self.does and all((self.allowance(name, usual) <= tolerated(name)).all() for name in self.bias)

    def or_from(self, larger: StepBias) -> StepBias:
        """Return these biases, or the biases that follow from a larger step where these are more certain.

        Where paths are apart, the error of averages along them does not follow from a larger step.
        """
        foreseen = larger.at(self.step)
        return replace(self, bias={name: own.or_from(foreseen.bias[name]) for name, own in self.bias.items()})

    def warning(self, dataset: xr.Dataset, sampled: bool, steady: bool, automatic: float = 0.0) -> str:
        """Return a warning of what the measurement may not tell of a run, or nothing.

        Parameters
        ----------
        dataset : Dataset
            Statistics of the run.
        sampled : bool
            Whether standard errors are missing for want of samples, not because nothing is random.
        steady : bool
            Whether the motion is stationary.
        automatic : float
            The step that the rules allow (s); up to it, a bias that is not known well is that of the rules.
        """

        def ran(name: str) -> tuple[np.ndarray, np.ndarray]:
            error = dataset[EVERY[name].error].values
            return dataset[name].values, error if sampled else np.nan_to_num(error)

        again = f"; compare with step={0.5 * self.step:.2g}."
        if math.isinf(self.certain):
            stays = "" if LOSSES in dataset.attrs else ", which the run did not"
            return f"The bias of the step is unknown: its measurement left the range of finite numbers{stays}{again}"
        name = "mean_square_velocity"
        value, error = ran(name)
        seen = self.measured[name] + self.margin * self.scatter
        for place in np.flatnonzero(value - self.margin * error > UNLIKE * seen)[:1]:
            return (
                f"Mean square velocity of {self.labels[BODY][place]!r} is {value[place]:.3g} m2 s-2 in the run, but "
                f"{self.measured[name][place]:.3g} where the bias of its step was measured{again}"
            )
        if steady:
            return ""
        if self.reached < REACHED and self._unlike(ran):
            return f"The bias of the step was measured in the first {100.0 * self.reached:.2g} % of the run only{again}"
        for name, bias in self.bias.items():
            value, error = ran(name)
            size = self._size(name, dataset)
            with np.errstate(divide="ignore", invalid="ignore"):
                unknown = bias.most(self.margin) > UNSURE + 3.0 * error / size
                if self.step <= automatic * (1.0 + 1e-9):
                    unknown &= np.isinf(bias.error)
                unknown &= (np.abs(bias.value) <= WORTH_SAYING + self.margin * bias.error) & ~np.asarray(bias.apart)
            for place in np.flatnonzero(unknown & (value != 0.0) & (3.0 * error < KNOWN * size))[:1]:
                label, known = self.labels[EVERY[name].dimension][place], bias.error[place]
                how = f"known to ± {100.0 * known:.2g} % only" if known < math.inf else "unknown: it was not seen"
                return f"The bias of the step in {EVERY[name].long_name} of {label!r} is {how}{again}"
        return ""

    def _size(self, name: str, dataset: xr.Dataset) -> np.ndarray:
        """Return the size to which the bias of a statistic of a run is relative."""
        return self.growth if name == GROWTH else size_of(name, lambda item: dataset[item].values)

    def _unlike(self, ran: Callable[[str], tuple[np.ndarray, np.ndarray]]) -> bool:
        """Whether the measured segments may differ from the whole run, from values of the run and their errors by name.

        Motion that is as strong as in the run, with contacts that close as often and as hard, has the same biases.
        """
        for name in REPRESENTATIVE & self.measured.keys():
            (value, error), seen = ran(name), self.measured[name]
            both = np.maximum(np.abs(value), np.abs(seen))
            scatter = np.nan_to_num(error) * math.sqrt(1.0 + 1.0 / self.reached)  # that of a part is larger
            if (np.abs(value - seen) > LIKE * both + self.margin * scatter).any():
                return True
        return False

    def added_to(self, dataset: xr.Dataset, automatic: float) -> xr.Dataset:
        """Return a dataset with the biases, and with standard errors that allow for them.

        Parameters
        ----------
        dataset : Dataset
            Statistics with the standard errors of their scatter.
        automatic : float
            The step that the rules allow (s): biases of larger ones are as much larger as the square of the step.
        """
        usual, where = self.usual(automatic), f" at a step of {self.seen_at:.3g} s, and reduced" * self.foreseen
        result: Variables = {}
        for name, bias in self.bias.items():
            statistic = EVERY[name]
            dimension, units, long_name = statistic.dimension, statistic.units, statistic.long_name
            part = "the root mean square" if statistic.square else "it"
            part += ", or of the mean rate of all changes where it may be 0" * (name == GROWTH)
            seen = bias.error[np.isfinite(bias.error)].max(initial=0.0)
            result[statistic.step_bias] = (
                (dimension,),
                bias.value,
                {
                    "units": "1",
                    "long_name": f"bias of the step in {long_name}, as a part of {part}",
                    "comment": f"measured on the network{where}; standard error at most {seen:.1g}",
                },
            )
            allowance = self.allowance(name, usual) * self._size(name, dataset)
            text = f"part of the standard error of {long_name} that allows for the bias of the step"
            result[statistic.allowance] = labelled((dimension,), allowance, units, text)
            result[statistic.allowance][2]["comment"] = "root mean square of the bias, given what was measured of it"
            for variable in (statistic, statistic.direct):
                if variable.name in dataset:
                    error = dataset[variable.error]
                    comment = f"of the scatter, and beside it {statistic.allowance}: square root of the sum of squares"
                    attrs = {**error.attrs, "comment": comment}
                    result[variable.error] = (dimension,), np.hypot(error.values, allowance), attrs
        return dataset.assign(result)
