"""Uncertain numbers of components: distributions that `scipy.stats` names."""

from __future__ import annotations

import difflib
from typing import Any, ClassVar, NoReturn

from impactlab.components.component import Component
from impactlab.components.fields import parameter
from impactlab.errors import InvalidInput

OUTSIDE = 1e-9
"""Probability outside of the range in which numbers must be valid, on each side."""

SUCH_AS = "il.Uncertain(scipy.stats.lognorm(0.1, scale=400.0))"


class Uncertain(Component):
    """A number that differs from one realization to another: a stiffness, a mass, a clearance, a restitution.

    It stands in the place of any number of a component. A network with uncertain numbers describes many networks:
    `simulate` draws from these, see `impactlab.uncertain`. Numbers in different places are independent, also where the
    same component stands for several bodies.

    Parameters
    ----------
    distribution : distribution of scipy.stats, or str
        A continuous distribution with its parameters, such as ``scipy.stats.lognorm(0.1, scale=400.0)``; or the name of
        one, with the parameters that follow.
    shapes : sequence of float
        Shape parameters, in the order of scipy.
    location, scale : float
        Location and scale, in the units of the number.

    Raises
    ------
    InvalidInput
        If scipy has no such distribution. A component refuses a distribution whose range holds numbers that it
        refuses; the range leaves out 1e-9 on each side.

    Examples
    --------
    >>> import scipy.stats
    >>> il.LinearOscillator(stiffness=il.Uncertain(scipy.stats.lognorm(0.1, scale=400.0)))
    LinearOscillator(stiffness=Uncertain(distribution='lognorm', shapes=(0.1,), scale=400.0))
    """

    distribution: Any = parameter()
    shapes: tuple[float, ...] = parameter(())
    location: float = parameter(0.0)
    scale: float = parameter(1.0, above=0.0)

    is_uncertain: ClassVar[bool] = True

    def __post_init__(self) -> None:
        if not isinstance(self.distribution, str):
            for name, value in _taken_apart(self.distribution).items():
                object.__setattr__(self, name, value)
        super().__post_init__()
        kind = _continuous(self.distribution)
        names = shape_names(kind)
        if len(self.shapes) != len(names) or not self.ppf(0.0) < self.median:
            raise InvalidInput(
                f"{self!r} is no distribution: scipy.stats.{self.distribution} takes "
                f"{f'the shapes {kind.shapes}, each in its own limits' if names else 'no shapes'}."
            )

    def ppf(self, share: Any) -> Any:
        """Return the quantiles at some shares between 0 and 1."""
        return _continuous(self.distribution).ppf(share, *self.shapes, loc=self.location, scale=self.scale)

    @property
    def median(self) -> float:
        """The median."""
        return float(self.ppf(0.5))

    @property
    def range(self) -> tuple[float, float]:
        """The ends of the range that holds all numbers but one in 10⁹ on each side."""
        return float(self.ppf(OUTSIDE)), float(self.ppf(1.0 - OUTSIDE))


def _continuous(name: str) -> Any:
    """Return a distribution of scipy by its name."""
    from scipy import stats  # components are described without it

    found = getattr(stats, name, None)
    if not isinstance(found, stats.rv_continuous):
        known = [item for item in dir(stats) if isinstance(getattr(stats, item), stats.rv_continuous)]
        near = difflib.get_close_matches(name, known, n=1)
        raise InvalidInput(
            f"scipy.stats has no continuous distribution {name!r}; "
            f"{f'did you mean {near[0]!r}?' if near else f'write one such as {SUCH_AS}.'}"
        )
    return found


def shape_names(kind: Any) -> list[str]:
    """Return the names of the shape parameters of a distribution."""
    return [name.strip() for name in kind.shapes.split(",")] if kind.shapes else []


def _taken_apart(frozen: Any) -> dict[str, Any]:
    """Return name and parameters of a distribution as scipy freezes it."""
    kind: Any = getattr(frozen, "dist", None)
    if not isinstance(getattr(kind, "name", None), str) or not hasattr(frozen, "args"):
        raise InvalidInput(f"Uncertain takes a distribution of scipy.stats, such as {SUCH_AS}, not {frozen!r}.")
    shapes = shape_names(kind)
    given = {**dict(zip([*shapes, "loc", "scale"], frozen.args, strict=False)), **frozen.kwds}
    return {
        "distribution": kind.name,
        "shapes": tuple(float(given[name]) for name in shapes),
        "location": float(given.get("loc", 0.0)),
        "scale": float(given.get("scale", 1.0)),
    }


def _refuse(self: Uncertain, *others: Any) -> NoReturn:
    raise InvalidInput(
        f"{self!r} is no single number: it can only stand in the place of a number of a component. Numbers that follow "
        "from uncertain ones are those of a function, il.uncertain(make, over, draws)."
    )


for _operation in ("add", "sub", "mul", "truediv", "pow"):
    setattr(Uncertain, f"__{_operation}__", _refuse)
    setattr(Uncertain, f"__r{_operation}__", _refuse)
for _operation in ("neg", "abs", "float", "lt", "le", "gt", "ge"):
    setattr(Uncertain, f"__{_operation}__", _refuse)
