"""What a stationary density of two bodies tells its user."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from impactlab.components.composition import Composition
from impactlab.components.literature import in_one_line
from impactlab.components.stored import entries, json_of, stored
from impactlab.inputs import checked, known_name
from impactlab.reference.densities import STATE_QUANTITIES, Curves, Densities
from impactlab.reference.fokker_planck.convergence import Convergence, Values
from impactlab.reference.fokker_planck.propagator import Propagator
from impactlab.reference.fokker_planck.reading import Reading
from impactlab.reference.fokker_planck.settings import coarser
from impactlab.results.dataset import provenance
from impactlab.results.schema import statistics

if TYPE_CHECKING:
    import xarray as xr


@checked
@dataclass(frozen=True, eq=False, repr=False)
class FokkerPlanckReference(Densities):
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

    Examples
    --------
    >>> law = il.fokker_planck(pair, tolerance=0.02)
    >>> law.density("hot", "velocity", [0.0, 1.0]).shape
    (2,)
    """

    network: Composition
    propagator: Propagator
    phase_density: np.ndarray
    errors: Convergence

    def statistics(self) -> xr.Dataset:
        """Return the default statistics but the peak force, with their errors.

        Returns
        -------
        xarray.Dataset
            Variables as those of `simulate`; each has an ``<name>_error``, the sum of the errors of
            all directions of the basis, at least that of the balances. Second moments of a body share one
            relative error, and so do the means of contact and of displacements. The attribute ``basis`` holds
            the basis.
        """
        dataset = self._dataset(self.errors.values)
        for name, error in self._dataset(self.errors.total).data_vars.items():
            attrs = {"units": error.attrs["units"], "long_name": f"numerical error of {error.attrs['long_name']}"}
            dataset[f"{name}_error"] = error.dims, error.values, attrs
        configuration = {"network": stored(self.network), "basis": self.basis}
        title = "stationary statistics from the Fokker-Planck equation"
        return dataset.assign_attrs(provenance(title, json_of(configuration), in_one_line(entries(configuration))))

    @property
    def basis(self) -> dict[str, float]:
        """Numbers of nodes, size of the box and step (s), as `fokker_planck` takes them."""
        return self.propagator.basis._asdict()

    def convergence(self) -> xr.Dataset:
        """Return how each statistic changes with one direction of the basis at a time.

        Returns
        -------
        xarray.Dataset
            The statistics with a dimension ``direction``: values with three quarters of the nodes
            in that direction, with a box smaller by √0.75, with a step longer by √2, and with one twice
            as long, each minus the value. ``basis`` (direction) is what the direction was changed to, ``balance_force``
            (oscillator; relative to the force of the contact), ``balance_moments`` (oscillator; largest relative
            change of a second moment by a step) and ``balance_power`` what should be 0.
        """
        import xarray as xr

        parts = [
            self._dataset({name: value - self.errors.values[name] for name, value in values.items()})
            for values in self.errors.coarser.values()
        ]
        dataset = xr.concat(parts, dim=xr.Variable("direction", list(self.errors.coarser)))
        changed = [
            getattr(coarser(self.propagator.well, self.propagator.basis, name), name.split()[0])
            for name in self.errors.coarser
        ]
        dataset["basis"] = (
            "direction",
            np.array(changed, dtype=float),
            {"long_name": "nodes, half the box in standard deviations, or step in s"},
        )
        for name, value in self.errors.balances.items():
            attrs = {"units": "1", "long_name": name.replace("_", " of ")}
            dataset[name] = (
                (("oscillator",), self._in_order(value), attrs) if len(value) == 2 else ((), value[0], attrs)
            )
        return dataset

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
        """Reorder values of the two bodies from the order of the contact to the order of the network."""
        names = self.propagator.pair.names
        return value[[names.index(name) for name in self.network.oscillators]] if len(value) == 2 else value

    @cached_property
    def _reading(self) -> Reading:
        return Reading(self.propagator, self.phase_density)

    def _curves(self, oscillator: str, quantity: str) -> Curves:
        names = self.propagator.pair.names
        known_name("body", oscillator, names)
        known_name("quantity", quantity, STATE_QUANTITIES)
        read = self._reading.displacement if quantity == "displacement" else self._reading.velocity
        found = read(names.index(oscillator))
        return Curves(found.density, found.probability_below)
