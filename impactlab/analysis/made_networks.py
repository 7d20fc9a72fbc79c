"""The networks that a function made, kept by the values of its parameters, so that nobody needs the function again."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from impactlab.analysis.orbit import MakeNetwork
from impactlab.components.stored import json_of, stored
from impactlab.errors import ImpactLabError, InvalidInput
from impactlab.networks.network import Network
from impactlab.results.dataset import CONFIGURATION, parsed
from impactlab.results.labels import Labelled


class MadeNetworks:
    """A function that makes networks, and the texts of all that it has made or refused."""

    def __init__(self, make: MakeNetwork) -> None:
        self.make, self.texts = make, dict[tuple[float, ...], str]()

    def __call__(self, **values: Any) -> Network:
        """Return the network at some values; these come in one order."""
        place = tuple(map(float, values.values()))
        try:
            network = self._made(values)
        except InvalidInput as error:
            self.texts[place] = json_of({"values": place, "network": {}, "refused": str(error)})
            raise
        if place not in self.texts:
            self.texts[place] = json_of({"values": place, "network": stored(network)})
        return network

    def _made(self, values: dict[str, Any]) -> Network:
        """Return what the function makes, or refuse it."""
        told = ", ".join(f"{name}={float(value):.6g}" for name, value in values.items())
        try:
            network = self.make(**values)
        except ImpactLabError:
            raise
        except Exception as error:
            raise InvalidInput(f"make fails at {told}: {type(error).__name__}: {error}") from error
        if not isinstance(network, Network):
            raise InvalidInput(f"make must return an il.Network, but at {told} it returned {network!r}.")
        return network

    def variable(self) -> Labelled:
        """Return all texts as a variable of a dataset."""
        return ("network",), np.array(list(self.texts.values())), {"long_name": "networks that were made"}


def made_again(dataset: xr.Dataset) -> MakeNetwork:
    """Return a function that makes the networks that are kept with a dataset, and refuses others."""
    if CONFIGURATION not in dataset:
        raise InvalidInput(f"The dataset has lost its variable {CONFIGURATION!r}; pass the complete dataset.")
    stored_ones = [parsed(text) for text in dataset[CONFIGURATION].values.ravel()]
    kept = {tuple(item["values"]): item for item in stored_ones}

    def make(**values: Any) -> Network:
        item = kept.get(tuple(values.values()))
        if item is None:  # not InvalidInput, which a branch takes for its end
            told = ", ".join(f"{name}={float(value)!r}" for name, value in values.items())
            raise ImpactLabError(
                f"The network at {told} is not stored with the dataset, which was interrupted or made by another "
                "version: call il.continue_orbits with the function that makes networks."
            )
        if not item["network"]:
            raise InvalidInput(item["refused"])
        return Network.from_dict(item["network"])

    return make
