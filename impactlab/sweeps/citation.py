"""What to cite with a result."""

from __future__ import annotations

import os

import xarray as xr

import impactlab
from impactlab.components.stored import entries, stored
from impactlab.inputs import checked
from impactlab.results.dataset import CONFIGURATION, configuration_of, load, parsed


@checked
def citation(source: impactlab.Network | xr.Dataset | xr.DataTree | str | os.PathLike[str]) -> str:
    """Return what to cite with a result: impactlab, and the sources of the components that were used.

    Parameters
    ----------
    source : Network, Dataset, str or path
        A network, what `simulate` or `sweep` returned, or a netCDF file of it.

    Returns
    -------
    str
        Entries of BibTeX. Those of a class of one's own are its class attribute `citation`.

    Raises
    ------
    InvalidInput
        If the source is none of these.

    Examples
    --------
    >>> print(il.citation(network).splitlines()[0])
    @software{impactlab,
    """
    if isinstance(source, impactlab.Network):
        return "\n\n".join(entries([stored(source)]))
    data = [configuration_of(source)]
    dataset = source if isinstance(source, xr.Dataset) else load(source)
    if isinstance(dataset, xr.Dataset) and CONFIGURATION in dataset:  # a sweep
        data += [parsed(item) for item in dataset[CONFIGURATION].values.ravel()]
    return "\n\n".join(entries(data))
