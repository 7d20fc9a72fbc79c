"""Random networks whose intervals are counted, and the short runs in which they are."""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import impactlab as il
from impactlab.assembly.model import Model
from impactlab.linear.decay import relaxation_time
from impactlab_numerics.trust import compound, mixtures, networks

CLASSES = networks.CLASSES | compound.CLASSES
"""Classes of the networks with even numbers; the others mix all mechanisms."""

TIMES = 6.0
"""Duration of runs of many realizations in relaxation times: some values within them are independent, others not."""

STEPS = 3000
"""Largest number of steps of such a run."""


class Drawn(NamedTuple):
    """A network and the options of a short run."""

    number: int
    kind: str  # class
    network: il.Network
    options: dict[str, Any]  # duration, step, realizations, and what the class is about

    @property
    def in_batches(self) -> bool:
        """Whether errors come from batches of few realizations."""
        return bool(self.options["realizations"] < 64)


def drawn(number: int, realizations: int) -> Drawn:
    """Return a numbered network, with a run of some realizations, or of the few that its class is about."""
    classes = mixtures.CLASSES if number % 2 else CLASSES
    kind, scene = networks.class_of(number // 2, classes), networks.scene_of(number // 2, classes)
    kept = "duration", "initial", "spin_up"
    options: dict[str, Any] = {name: scene.options[name] for name in kept if name in scene.options}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        options["step"] = float(scene.network.check().dataset.attrs["step"])
    options["realizations"] = min(scene.options["realizations"], realizations)
    if options["realizations"] == realizations:
        slowest = relaxation_time(Model.of(scene.network))
        options["duration"] = min(options["duration"], TIMES * slowest, STEPS * options["step"])
        if scene.transient and "initial" not in options:
            options |= {"initial": "rest", "spin_up": 0.0}
    return Drawn(number, kind, scene.network, options)
