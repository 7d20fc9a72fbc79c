"""The bias of a step in each statistic, as measured on the network, and what follows from it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from impactlab.results.labels import Variables, labelled
from impactlab.results.schema import BODY, CONTACT, OF_STATES, STATE, statistic_of

if TYPE_CHECKING:
    import xarray as xr

MOST_BIAS = 0.0015
"""Bias of the step, as a part of a statistic, up to which a step that is chosen will do."""

WORTH_SAYING = 0.005
"""Bias of a step from which on there is a warning."""

USUAL_BIAS = MOST_BIAS / 3.0
"""Standard deviation of the biases of chosen steps before a measurement, so that hardly any is beyond what will do; in
51 random networks it was 0.05 % by maximum likelihood."""

FARTHEST = 10.0
"""Times the automatic step from which on biases are not expected to grow: hardly any larger step is let through."""

CERTAIN, LOOKED_AT = 2.5, 10
"""Standard errors within which a bias is not known, with so many statistics looked at."""

UNLIKE = 2.0
"""Ratio of the mean square velocity of a run to that in the measurement beyond which this says nothing of the run."""

REPRESENTATIVE, LIKE = {"mean_square_displacement", "mean_square_velocity", "contact_rate", "mean_contact_force"}, 0.25
"""Statistics, and the part by which those of a measurement may differ from those of the run that it stands for."""

UNSURE = 6.0 * WORTH_SAYING
"""Bias that must be excluded, beside three standard errors of the run, where motion is not stationary; at a third of it
ten of 75 networks raised a warning, and no value was off."""

REACHED = 0.95
"""Share of a run that is not stationary up to which a measurement must reach."""

KNOWN = 0.1
"""Three standard errors, as a part of a statistic, up to which it counts what is not known of its bias."""

HEAVY = 2.0
"""Factor of standard errors along chaotic paths: few long flights make their tails heavier than normal ones."""

WANDERING = 2.0 * WORTH_SAYING
"""Standard error of an average along a path that small errors change, as a part of it, from which on it is said."""
UNIMPROVED = 0.8
"""Part of the bias of a state that is left at half of a step, or less, where no step will do."""

FEWEST = 8
"""Fewest segments that tell how long energies are correlated."""

STILL = 1e-9
"""Part of the mean square of a displacement below which its variance is rounding, or what a spin-up has left."""

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

MAY_BE_ZERO = {"mean_displacement": "mean_square_displacement", "mean_law_state": "mean_square_law_state"}
"""Means that may be 0: their bias is a part of the root of a mean square."""


@dataclass(frozen=True, eq=False)
class StepError:
    """Bias of a step in each statistic, as measured.

    Attributes
    ----------
    step : float
        The step (s).
    bias, error : dict of str to (body or contact,) ndarray
        By the name of the statistic, as a part of its value (of the root mean square for means that may be 0);
        standard errors.
    labels : dict of str to tuple of str
        Names of bodies and contacts by dimension.
    measured : dict of str to (body or contact,) ndarray
        Statistics at the step, as measured on the way.
    scatter : (body,) ndarray
        Standard error of the measured mean square velocity.
    reached : float
        Share of the run that is over where the measurement ends.
    unsure : dict of str to (body or contact,) ndarray
        Standard errors of the biases beside `error`, of what the compared paths cannot tell. They do not count where a
        step is chosen.
    apart : dict of str to (body or contact,) ndarray of bool
        Whether small changes grow until paths are apart; errors are then those of averages along them.
    doubt_of_order : float
        Part of a bias that is unsure, since it may fall with another power of the step than is expected.
    growth : (state,) ndarray
        What biases of growth rates of states are parts of.
    order : float
        Power of the step with which biases are taken to fall.
    seen_at : float
        Larger step at which they were measured (s), if it is another.
    """

    step: float
    bias: dict[str, np.ndarray]
    error: dict[str, np.ndarray]
    labels: dict[str, tuple[str, ...]]
    measured: dict[str, np.ndarray] = field(default_factory=dict)
    scatter: np.ndarray | float = 0.0
    reached: float = 1.0
    unsure: dict[str, np.ndarray] = field(default_factory=dict)
    apart: dict[str, np.ndarray] = field(default_factory=dict)
    doubt_of_order: float = 0.0
    growth: np.ndarray = field(default_factory=lambda: np.zeros(0))
    order: float = 2.0
    seen_at: float = 0.0

    @property
    def foreseen(self) -> bool:
        """Whether it follows from a measurement at another step."""
        return self.seen_at > self.step

    @classmethod
    def infinite(cls, step: float, bodies: tuple[str, ...], contacts: tuple[str, ...]) -> Self:
        """Return that of a step at which the motion leaves the range of finite numbers."""
        bias = {"mean_square_velocity": np.full(len(bodies), np.inf)}
        return cls(step, bias, {name: np.zeros(len(bodies)) for name in bias}, {BODY: bodies, CONTACT: contacts}, bias)

    @property
    def limit(self) -> float:
        """Standard errors within which biases are not known: of many statistics the largest is far off by chance."""
        return limit_of(sum(map(len, self.bias.values())))

    @property
    def worst(self) -> tuple[str, str, float, float]:
        """The statistic whose bias is most certainly large: name, label, bias and standard error."""
        return self._worst(lambda name: 1.0)

    def _worst(self, size: Callable[[str], float]) -> tuple[str, str, float, float]:
        """Return the same where biases count as parts of some size."""
        found, beyond, limit = ("", "", 0.0, 0.0), 0.0, self.limit
        for name, bias in self.bias.items():
            excess = (np.abs(bias) - limit * self.error[name]) / size(name)
            if excess.max(initial=beyond) > beyond:
                place = int(excess.argmax())
                label = self.labels[statistic_of(name).dimension][place]
                found, beyond = (name, label, float(bias[place]), float(self.error[name][place])), excess[place]
        return found

    @property
    def certain(self) -> float:
        """Largest bias of any statistic, without what may be chance."""
        _, _, bias, error = self.worst
        return max(abs(bias) - self.limit * error, 0.0)

    @property
    def does(self) -> bool:
        """Whether no bias is certainly too large."""
        name, _, bias, error = self._worst(most_of)
        return not name or abs(bias) - self.limit * error <= most_of(name)

    @property
    def surely_small(self) -> bool:
        """Whether all biases are surely small enough."""
        return all(
            (abs(self.bias[name]) + self.limit * error <= most_of(name)).all() for name, error in self.error.items()
        )

    def unclear(self, time: float) -> bool:
        """Whether a bias may be worth saying, beside the standard error that so many closings in some time (s) leave.

        Those of bodies are not counted on: balances may make them as small as they like.
        """
        with np.errstate(divide="ignore", invalid="ignore"):
            rates = self.measured.get("contact_rate", np.zeros(0))
            of_contacts = np.nan_to_num(1.0 / np.sqrt(time * rates), nan=np.inf)
        beside = {BODY: np.zeros(1), CONTACT: of_contacts, STATE: np.zeros(1)}
        for name, error in self.error.items():
            largest = np.where(np.isfinite(error), np.abs(self.bias[name]) + self.limit * error, 0.0)
            if (largest > WORTH_SAYING + beside[statistic_of(name).dimension]).any():
                return True
        return False

    @property
    def better(self) -> float:
        """A step that makes the bias small enough, if it falls with the square of the step (s)."""
        name, _, bias, _ = self._worst(most_of)
        if not name or abs(bias) <= most_of(name):
            return self.step
        return self.step * max(0.25, 0.8 * math.sqrt(most_of(name) / abs(bias)))

    def follows_the_step(self, before: StepError) -> bool:
        """Whether a state is as far off as it was at a step twice as large or more, as a count of steps is."""
        (name, label, bias, _), (*other, bias_before, _) = (item._worst(most_of) for item in (self, before))
        halved = self.step <= 0.5 * before.step
        return name in OF_STATES and [name, label] == other and halved and abs(bias) > UNIMPROVED * abs(bias_before)

    def scattered(self, error: dict[str, np.ndarray], apart: dict[str, np.ndarray]) -> StepError:
        """Return these biases with other errors where paths are apart."""
        errors = {name: np.where(apart[name], HEAVY * error[name], own) for name, own in self.error.items()}
        return replace(self, error=errors, apart=apart)

    def told(self) -> StepError:
        """Return these biases with what the compared paths cannot tell in their standard errors."""
        error = {name: np.hypot(own, self.unsure.get(name, 0.0)) for name, own in self.error.items()}
        return replace(self, error=error, unsure={})

    def with_order(self) -> StepError:
        """Return these biases with errors that allow for another power of the step; none is less certain for that."""
        error = {name: np.hypot(own, self.doubt_of_order * self.bias[name]) for name, own in self.error.items()}
        return replace(self, error=error, doubt_of_order=0.0)

    @property
    def wandering(self) -> str:
        """Say how well averages along paths are known that are apart; nothing where no path is, or they are known."""
        known = {
            name: np.where(self.apart[name] & np.isfinite(error), error, 0.0) / (math.sqrt(2.0) * HEAVY)
            for name, error in self.error.items()
            if name in self.apart
        }
        name = max(known, key=lambda name: known[name].max(initial=0.0), default="")
        if not name or known[name].max(initial=0.0) <= WANDERING:
            return ""
        place = int(known[name].argmax())
        label = self.labels[statistic_of(name).dimension][place]
        return (
            f"Averages along this path are known to ± {100.0 * known[name][place]:.2g} % only "
            f"({statistic_of(name).long_name} of {label!r}): small errors change it as they change chaotic paths, at "
            "any step. Run for longer, or use realizations with different initial= values."
        )

    def at(self, step: float) -> StepError:
        """Return what is known of the bias of a smaller step (s): it falls with a power of the step, from 1 to `order`.

        The order is expected, and what the first power would make of it counts as a standard error.
        """
        ratio = step / self.step
        expected, beyond = ratio**self.order, ratio * (1.0 - ratio ** (self.order - 1.0))
        bias = {name: expected * item for name, item in self.bias.items()}
        error = {name: np.hypot(expected * item, beyond * np.abs(self.bias[name])) for name, item in self.error.items()}
        return replace(self, step=step, bias=bias, error=error, seen_at=max(self.step, self.seen_at))

    def allowance(self, name: str, usual: float = USUAL_BIAS) -> np.ndarray:
        """Return the root mean square of the bias of a statistic, given what was measured: as large as it may well be.

        A bias b of which nothing is known but that the step was chosen is a normal number with the standard deviation
        s that is `usual`, more of states, with whose larger biases a step will do. Measured as b̂ ± σ, it has the mean
        q b̂ and the variance q σ² = (1 − q) s², with q = s²/(s² + σ²). What is beyond the `limit` is no unusual
        measurement but an unusual bias, and known: q = 1.
        """
        bias, error, usual = self.bias[name], self.error[name], usual * (most_of(name) / MOST_BIAS)
        known = np.where(np.abs(bias) > self.limit * error, 1.0, 1.0 / (1.0 + (error / usual) ** 2))
        result: np.ndarray = np.hypot(known * bias, np.sqrt(1.0 - known) * usual)
        return result

    def usual(self, automatic: float) -> float:
        """Return the standard deviation of biases that is to be expected, from the step that rules allow (s)."""
        return USUAL_BIAS * min(max(1.0, self.step / max(automatic, 1e-300)), FARTHEST) ** 2

    def will_do(self, automatic: float) -> bool:
        """Whether no bias is too large, nor may well be; where one was not seen, the rules know best."""
        if self.step > automatic * (1.0 + 1e-9) and not all(np.isfinite(item).all() for item in self.error.values()):
            return False
        usual = self.usual(automatic)
        return self.does and all((self.allowance(name, usual) <= most_of(name)).all() for name in self.bias)

    def or_from(self, larger: StepError) -> StepError:
        """Return these biases, or those that follow from the ones of a larger step where they are known better.

        Where paths are apart, no larger step tells how well averages along them are known.
        """
        foreseen = larger.at(self.step)
        better = {
            name: (foreseen.error[name] < error) & ~self.apart.get(name, np.zeros(1, dtype=bool))
            for name, error in self.error.items()
        }
        bias, error = (
            {name: np.where(better[name], other[name], own[name]) for name in better}
            for own, other in ((self.bias, foreseen.bias), (self.error, foreseen.error))
        )
        return replace(self, bias=bias, error=error)

    def doubt(self, dataset: xr.Dataset, sampled: bool, steady: bool, automatic: float = 0.0) -> str:
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
            error = dataset[statistic_of(name).error].values
            return dataset[name].values, error if sampled else np.nan_to_num(error)

        again = f"; compare with step={0.5 * self.step:.2g}."
        if math.isinf(self.certain):
            return (
                "The bias of the step is unknown: its measurement left the range of finite numbers, which the run did "
                f"not{again}"
            )
        name = "mean_square_velocity"
        value, error = ran(name)
        seen = self.measured[name] + self.limit * self.scatter
        for place in np.flatnonzero(value - self.limit * error > UNLIKE * seen)[:1]:
            return (
                f"Mean square velocity of {self.labels[BODY][place]!r} is {value[place]:.3g} m2 s-2 in the run, but "
                f"{self.measured[name][place]:.3g} where the bias of its step was measured{again}"
            )
        if steady:
            return ""
        if self.reached < REACHED and self._unlike(ran):
            return f"The bias of the step was measured in the first {100.0 * self.reached:.2g} % of the run only{again}"
        no = np.zeros((), dtype=bool)
        for name, bias in self.bias.items():
            value, error = ran(name)
            size = self._size(name, dataset)
            with np.errstate(divide="ignore", invalid="ignore"):
                may_be = np.abs(bias) + self.limit * self.error[name]
                unknown = may_be > UNSURE + 3.0 * error / size
                if self.step <= automatic * (1.0 + 1e-9):
                    unknown &= np.isinf(self.error[name])
                unknown &= (np.abs(bias) <= WORTH_SAYING + self.limit * self.error[name]) & ~self.apart.get(name, no)
            for place in np.flatnonzero(unknown & (value != 0.0) & (3.0 * error < KNOWN * size))[:1]:
                label, known = self.labels[statistic_of(name).dimension][place], self.error[name][place]
                how = f"known to ± {100.0 * known:.2g} % only" if known < math.inf else "unknown: it was not seen"
                return f"The bias of the step in {statistic_of(name).long_name} of {label!r} is {how}{again}"
        return ""

    def _size(self, name: str, dataset: xr.Dataset) -> np.ndarray:
        """Return what the bias of a statistic of a run is a part of."""
        return self.growth if name == GROWTH else size_of(name, lambda item: dataset[item].values)

    def _unlike(self, ran: Callable[[str], tuple[np.ndarray, np.ndarray]]) -> bool:
        """Whether what was measured may differ from the whole run, from values of the run and their errors by name.

        Motion that is as strong as in the run, with contacts that close as often and as hard, has the same biases.
        """
        for name in REPRESENTATIVE & self.measured.keys():
            (value, error), seen = ran(name), self.measured[name]
            both = np.maximum(np.abs(value), np.abs(seen))
            scatter = np.nan_to_num(error) * math.sqrt(1.0 + 1.0 / self.reached)  # that of a part is larger
            if (np.abs(value - seen) > LIKE * both + self.limit * scatter).any():
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
            statistic = statistic_of(name)
            dimension, units, long_name = statistic.dimension, statistic.units, statistic.long_name
            part = "the root mean square" if name in MAY_BE_ZERO else "it"
            part += ", or of the mean rate of all changes where it may be 0" * (name == GROWTH)
            seen = self.error[name][np.isfinite(self.error[name])].max(initial=0.0)
            result[statistic.step_bias] = (
                (dimension,),
                bias,
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


def most_of(name: str) -> float:
    """Return the bias of a statistic up to which a step that is chosen will do.

    States of laws may have what need not be said: few look at the velocity at which a contact has closed, which takes
    steps four times as fine as the motion.
    """
    return WORTH_SAYING if statistic_of(name).dimension == STATE else MOST_BIAS


def limit_of(number: int) -> float:
    """Return the standard errors within which biases are not known where so many are looked at."""
    return math.sqrt(CERTAIN**2 + 2.0 * math.log(max(1.0, number / LOOKED_AT)))


def size_of(name: str, mean: Callable[[str], np.ndarray]) -> np.ndarray:
    """Return what the bias of a statistic is a part of, from means by name."""
    if name in MAY_BE_ZERO:
        return np.asarray(np.sqrt(mean(MAY_BE_ZERO[name])))
    size = np.abs(mean(name))
    if name == "variance_displacement":  # of a body that a load holds still
        size = np.maximum(size, STILL * mean("mean_square_displacement"))
    return np.asarray(size)
