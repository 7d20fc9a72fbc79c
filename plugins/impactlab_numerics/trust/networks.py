"""Random networks of all classes that people put together, by their numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

import impactlab as il
from impactlab_numerics.trust.classes import contacts, damping, forces, runs
from impactlab_numerics.trust.drawing import Costly, Scene

Draw = Callable[[np.random.Generator], Scene]
"""What draws a network of a class."""

CLASSES: dict[str, Draw] = {
    "home": contacts.home,
    "rate-dependent contacts": contacts.rate_dependent_contacts,
    "residual damping": damping.residual_damping,
    "kinks, jumps, saturation": contacts.kinked,
    "given forces": forces.given_forces,
    "varying noise": forces.varying_noise,
    "bounded noise": forces.bounded_noise,
    "preloads and static loads": contacts.preloads,
    "heavy bases": forces.heavy_bases,
    "unequal temperatures": forces.unequal_temperatures,
    "rows of undamped bodies": damping.rows_of_undamped_bodies,
    "starts and short runs": runs.starts,
    "few realizations": runs.few_realizations,
    "rare contacts": contacts.rare_contacts,
    "weak damping": damping.weak_damping,
    "overdamped": damping.overdamped,
}
"""Classes of networks by name, in the order in which they are drawn."""


def class_of(seed: int, classes: Mapping[str, Draw] = CLASSES) -> str:
    """Name of the class of a numbered network: one after the other."""
    return list(classes)[seed % len(classes)]


def scene_of(seed: int, classes: Mapping[str, Draw] = CLASSES) -> Scene:
    """Draw a numbered network, again while it would take too long."""
    draw = classes[class_of(seed, classes)]
    for attempt in range(1000):
        try:
            return draw(np.random.default_rng([seed, attempt]))
        except Costly:
            continue
    raise il.InvalidInput(f"No network {seed} of the class {class_of(seed, classes)!r} is cheap enough.")
