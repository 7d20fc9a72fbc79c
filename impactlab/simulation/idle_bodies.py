"""Bodies that nothing can touch are solved apart from the others: they need no steps."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from impactlab.assembly.mechanism import Mode, refusing
from impactlab.assembly.model import Described, Model
from impactlab.components.composition import Composition
from impactlab.components.sides import bodies_of
from impactlab.integrators.base import Integrator
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.results.schema import STATISTICS

if TYPE_CHECKING:
    import xarray as xr

    from impactlab.records.record import Record


def split(
    model: Model, integrator: Integrator, initial: object, records: Iterable[Record]
) -> tuple[Composition, Composition] | None:
    """Return the part of a network where something can touch, and the rest, if they can be simulated apart.

    Parts that no contact, coupling or source connects do not affect each other. The rest are bodies on
    which nothing but constant white noise acts; their transitions are exact over any time.
    Records of both parts at once keep the network whole, and so does a given start.
    """
    busy = np.zeros(len(model.bodies), dtype=bool)
    for mechanism in refusing(model, Mode.IDLE_BODIES):
        busy |= mechanism.bodies(model)
    alone = isinstance(integrator, ExactFlow) and integrator.crosses and not isinstance(initial, Mapping)
    if not alone or busy.all() or any(record.samples for record in records):
        return None
    labels = model.connected.copy()
    for slots in (slots for kind in model.sources.values() for slots in kind.joining):
        labels[np.isin(labels, labels[slots])] = labels[slots[0]]
    idle = ~np.isin(labels, labels[busy])
    if not idle.any() or idle.all():
        return None
    return _only(model, ~idle), _only(model, idle)


def _only(model: Model, chosen: np.ndarray) -> Composition:
    """Return the network of the chosen bodies, which nothing connects with the others."""
    network = model.network
    names = {name for name, keep in zip(model.bodies.names, chosen, strict=True) if keep}
    return Composition(
        {name: body for name, body in network.oscillators.items() if name in names},
        {name: item for name, item in network.contacts.items() if not names.isdisjoint(bodies_of(item))},
        network.excitations_on(names),
        {name: item for name, item in network.couplings.items() if not names.isdisjoint(bodies_of(item))},
    )


def joined(network: Described, busy: xr.Dataset, idle: xr.Dataset) -> xr.Dataset:
    """Return one dataset of both parts, its bodies in the order of the network."""
    import xarray as xr

    both = xr.merge([busy, idle.drop_dims("contact", errors="ignore")], join="outer", compat="no_conflicts")
    of_step = [name for statistic in STATISTICS.values() for name in (statistic.step_bias, statistic.allowance)]
    # the flow of idle bodies is exact
    both = both.assign({name: both[name].fillna(0.0) for name in of_step if name in both})
    drifts = [part.attrs["drift"] for part in (busy, idle)]
    attributes = {**busy.attrs, "drift": max(drifts, key=lambda drift: (drift == drift, drift))}
    return both.sel(oscillator=list(network.oscillators)).assign_attrs(attributes)
