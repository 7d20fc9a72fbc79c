"""What a stationary density of two bodies tells its user."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from impactlab.component import suggestion
from impactlab.dataset import provenance, statistics
from impactlab.errors import InvalidInput
from impactlab.network import Network
from impactlab.phase_space.convergence import Convergence, Values
from impactlab.phase_space.propagator import Propagator
from impactlab.phase_space.reading import Characteristic, Reading
from impactlab.phase_space.settings import coarser

if TYPE_CHECKING:
    import xarray as xr

_QUANTITIES = ("displacement", "velocity")


@dataclass(frozen=True, eq=False, repr=False)
class FokkerPlanckReference:
    """Stationary law of two bodies in contact; `fokker_planck` makes it.

    Parameters
    ----------
    network : Network
        The network.
    propagator : Propagator
        The grid, and the step on it.
    phase_density : (gap, center, first, second) ndarray
        The density at its nodes.
    errors : Convergence
        Statistics on this grid and on coarser ones.
    """

    network: Network
    propagator: Propagator
    phase_density: np.ndarray
    errors: Convergence

    def statistics(self) -> xr.Dataset:
        """Return the default statistics but the peak force, with their errors.

        Returns
        -------
        xarray.Dataset
            Variables as those of `simulate`; each has an ``<name>_error``, the sum of the errors of
            all directions of the basis. The attribute ``basis`` holds the numbers of nodes and the step.
        """
        dataset = self._dataset(self.errors.values)
        for name, error in self._dataset(self.errors.total).data_vars.items():
            attrs = {"units": error.attrs["units"], "long_name": f"numerical error of {error.attrs['long_name']}"}
            dataset[f"{name}_error"] = error.dims, error.values, attrs
        configuration = {"network": self.network.to_dict(), "basis": self.basis}
        return dataset.assign_attrs(provenance("stationary statistics from the Fokker-Planck equation", configuration))

    @property
    def basis(self) -> dict[str, float]:
        """Numbers of nodes and the step (s), as `fokker_planck` takes them."""
        return self.propagator.basis._asdict()

    def convergence(self) -> xr.Dataset:
        """Return how each statistic changes with one direction of the basis at a time.

        Returns
        -------
        xarray.Dataset
            The statistics with a dimension ``direction``: values with three quarters of the nodes
            in that direction, with a step longer by √2, and with one twice as long, each
            minus the value. ``basis`` (direction) is what the direction was changed to, ``balance_force``
            (oscillator; relative to the force of the contact), ``balance_moments`` (oscillator; largest relative
            change of a second moment by a step) and ``balance_power`` what should be 0.
        """
        import xarray as xr

        parts = [
            self._dataset({name: value - self.errors.values[name] for name, value in values.items()})
            for values in self.errors.coarser.values()
        ]
        dataset = xr.concat(parts, dim=xr.Variable("direction", list(self.errors.coarser)))
        changed = [getattr(coarser(self.propagator.basis, name), name.split()[0]) for name in self.errors.coarser]
        dataset["basis"] = ("direction", np.array(changed, dtype=float), {"long_name": "nodes, or step in s"})
        for name, value in Reading(self.propagator, self.phase_density).balances.items():
            attrs = {"units": "1", "long_name": name.replace("_", " of ")}
            dataset[name] = (
                (("oscillator",), self._in_order(value), attrs) if len(value) == 2 else ((), value[0], attrs)
            )
        return dataset

    def density(self, oscillator: str, quantity: str, grid: Any) -> np.ndarray:
        """Return the probability density of a displacement or a velocity.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            Whose density.
        grid : array_like
            Where (m or m s-1).

        Returns
        -------
        ndarray
            Density (m-1 or s m-1), of the shape of `grid`.

        Raises
        ------
        InvalidInput
            If a name is unknown or a number is not finite.
        """
        law, places = self._law(oscillator, quantity), _finite("grid", grid)
        return law.density(places.ravel()).reshape(places.shape)

    def bin_density(self, oscillator: str, quantity: str, edges: Any) -> np.ndarray:
        """Return the averages of the density over bins, as a histogram estimates them.

        Parameters
        ----------
        oscillator : str
            Name of the body.
        quantity : {"displacement", "velocity"}
            Whose density.
        edges : array_like
            Increasing edges of the bins (m or m s-1).

        Returns
        -------
        ndarray
            One value for every bin (m-1 or s m-1).

        Raises
        ------
        InvalidInput
            If a name is unknown or the edges do not increase.
        """
        law, places = self._law(oscillator, quantity), _finite("edges", edges)
        if places.ndim != 1 or len(places) < 2 or not (np.diff(places) > 0.0).all():
            raise InvalidInput("edges must be at least two increasing numbers in one dimension.")
        return np.asarray(np.diff(law.probability_below(places)) / np.diff(places))

    def __repr__(self) -> str:
        basis = self.propagator.basis
        return (
            f"FokkerPlanckReference: {' and '.join(self.propagator.pair.names)}, {basis.unknowns:.3g} unknowns\n"
            f"  {basis}\n  relative errors: {self.errors.summary()}"
        )

    def _dataset(self, values: Values) -> xr.Dataset:
        ordered = {name: self._in_order(value) for name, value in values.items()}
        return statistics(list(self.network.oscillators), list(self.network.contacts), ordered)

    def _in_order(self, value: np.ndarray) -> np.ndarray:
        """Return what belongs to the bodies of the contact in the order of the network."""
        names = self.propagator.pair.names
        return value[[names.index(name) for name in self.network.oscillators]] if len(value) == 2 else value

    def _law(self, oscillator: str, quantity: str) -> Characteristic:
        names = self.propagator.pair.names
        for kind, name, known in (("body", oscillator, names), ("quantity", quantity, _QUANTITIES)):
            if name not in known:
                raise InvalidInput(f"There is no {kind} {name!r}; {suggestion(name, known)}")
        reading = Reading(self.propagator, self.phase_density)
        law: Characteristic = getattr(reading, quantity)(names.index(oscillator))
        return law


def _finite(name: str, values: Any) -> np.ndarray:
    array = np.asarray(values, dtype=float)
    if not np.isfinite(array).all():
        raise InvalidInput(f"{name} must hold finite numbers only.")
    return array
