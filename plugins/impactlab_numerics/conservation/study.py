"""The conservation study: invariants of the motion without friction and noise, and orders of convergence."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Self

import impactlab as il
from impactlab.studies import FolderStudy, Item

SAMPLES = 3000
"""Samples of a run."""

PATH_DURATION = 2.0
"""Length of the paths whose order is measured (s)."""

PATH_INTERVAL = 0.25
"""Time between samples of these paths (s)."""

COARSEST = {"ExactFlow": 2.0**-6, "RungeKutta4": 2.0**-6, "EulerMaruyama": 2.0**-12}
"""Largest step of each integrator at which its order shows (s)."""


BOUNCES = 256
"""Pairs whose single contact is followed."""

BOUNCE_STEPS = (0.5, 0.25, 0.125, 0.0625)
"""Steps of these times the frequency of the contact."""


class ConservationStudy(FolderStudy):
    """Energy, time reversal, momentum and observed orders.

    Networks without friction, noise and given forces keep their energy. It is followed over many contacts,
    at the automatic step and at parts of it, and what one contact does to it is compared with theory. The
    motion is reversed after some contacts and must come back; a free chain must keep its momentum. The order
    of each integrator is measured path by path, with smooth forces and with contacts.
    """

    name: ClassVar[str] = "conservation"
    title: ClassVar[str] = "Conservation: energy over many contacts, time reversal, momentum, observed orders"

    captions: ClassVar[Mapping[str, str]] = {
        "energy": (
            "Relative error of the energy against the number of contacts, one panel for each scene and one line "
            "for each step; last, what one contact does to it, with theory as lines."
        ),
        "reversal": (
            "Distance from the start after a reversal of all velocities, against the number of contacts before it."
        ),
        "order": "Largest error of paths against the step for each integrator, with smooth forces and with contacts.",
    }

    sections: ClassVar[Mapping[str, str]] = {
        "energy": "energy stays while no contact opens or closes, and wanders slowly where they do",
        "time reversal": "with all velocities reversed the motion comes back to its start",
        "momentum": "a free chain keeps its momentum",
        "order": "errors fall with the step by the order of each integrator",
    }

    contacts: float = il.parameter(1e6, minimum=100.0)
    copies: int = il.parameter(4, minimum=2)
    halvings: int = il.parameter(2, minimum=1)
    reversed_contacts: tuple[float, ...] = il.parameter((3.0, 10.0, 30.0, 100.0, 300.0))
    momentum_contacts: float = il.parameter(1e5, minimum=10.0)
    order_steps: int = il.parameter(5, minimum=3)
    seed: int = il.parameter(2023, minimum=0)

    def quick(self) -> Self:
        """The smoke form: few contacts."""
        return self.replace(contacts=2000.0, momentum_contacts=1000.0, reversed_contacts=(3.0, 10.0, 100.0))

    @property
    def path_copies(self) -> int:
        """Copies whose paths are compared with those of a solver: the error at a kink depends on the start."""
        return 16 * self.copies

    def items(self) -> list[Item]:
        """The scenes of constant energy at several steps, a free chain, and short paths."""
        from impactlab_numerics.conservation.scenes import (
            BOUNCE_DURATION,
            BOUNCING,
            SCENES,
            automatic_step,
            bounces,
            free_chain,
            path_starts,
            paths,
            side_by_side,
            starts,
        )

        items = []
        for number, (name, scene) in enumerate(SCENES.items()):
            network = side_by_side(scene.make(), self.copies)
            initial = starts(scene.make(), self.copies, scene.speed, [self.seed, number])
            for halving in range(self.halvings + 1):
                # the same work at each step, but for the first
                duration = self.contacts / scene.rate / 2.0 ** max(0, halving - 1)
                step = automatic_step(network, initial, duration)
                options = {"initial": initial, **_sampled(duration, step / 2.0**halving), "rng": self.seed}
                items.append(Item(key(name, halving), network, options))
        free, initial = free_chain(), {"velocity": {f"body_{k}": (-1.0) ** k + 0.1 for k in range(8)}}
        duration = self.momentum_contacts / 2.0
        step = automatic_step(free, initial, duration)
        items.append(Item("momentum", free, {"initial": initial, **_sampled(duration, step), "rng": self.seed}))
        for kind in BOUNCING:
            network, initial, frequency = bounces(kind, BOUNCES, self.seed)
            for index, step in enumerate(BOUNCE_STEPS):
                step = BOUNCE_DURATION / math.ceil(BOUNCE_DURATION * frequency / step)
                options = {"duration": BOUNCE_DURATION, "record": il.Trajectory(BOUNCE_DURATION), "rng": self.seed}
                given = {"step": step, "integrator": il.ExactFlow(measured=False), "initial": initial}
                items.append(Item(f"bounce_{kind}_{index}", network, {**options, **given}))
        for name, path in paths().items():
            for integrator in (il.ExactFlow(measured=False), il.RungeKutta4(), il.EulerMaruyama()):
                kind = type(integrator).__name__
                for halving in range(self.order_steps):
                    options = {
                        "duration": PATH_DURATION,
                        "step": COARSEST[kind] / 2.0**halving,
                        "integrator": integrator,
                        "initial": path_starts(self.path_copies),
                        "record": il.Trajectory(PATH_INTERVAL),
                        "rng": self.seed,
                    }
                    network = side_by_side(path.network, self.path_copies)
                    items.append(Item(f"{kind}_{name}_{halving}", network, options))
        return items


def key(scene: str, halving: int) -> str:
    """Return the key of a scene of constant energy at a step."""
    return f"{scene.replace(', ', '_').replace(' ', '_')}_{halving}"


def _sampled(duration: float, step: float) -> dict[str, Any]:
    """Return the options of a run that is sampled at whole steps, the step being made a little smaller."""
    interval = duration / SAMPLES
    step = interval / math.ceil(interval / step)
    return {
        "duration": duration,
        "step": step,
        "integrator": il.ExactFlow(measured=False),
        "record": il.Trajectory(interval),
    }
