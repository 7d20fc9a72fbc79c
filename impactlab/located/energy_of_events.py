"""The record of energy flows, from integrals over the pieces of runs without steps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.loads import ConstantForce, Harmonic
from impactlab.kernels.integrals import CONTACT_FORCE, COSINE, DISPLACEMENT, FUNCTION, SINE, VELOCITY
from impactlab.located.given_waves import Wave, given_waves
from impactlab.located.rows_of_couplings import inner_springs, rows_of_couplings
from impactlab.located.scenes import wave_of
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.power_accounts import Powers, summed

Factor = Mapping[tuple[int, int], float]
"""A sum of factors of products, with their weights, by kind and number; see `impactlab.kernels.integrals`."""

CONSTANT = -1, 0
"""The factor 1."""


Terms = list[tuple[float, int]]
"""Weights, and numbers of products; −1 and less for how far bodies go, the first for body 0."""


class Integrals(NamedTuple):
    """Integrals over the run of each realization, and the states at both ends."""

    products: np.ndarray  # (product, lane)
    squares: np.ndarray  # (body, lane) of v², 0 of bodies of given motion
    begin: tuple[np.ndarray, np.ndarray]  # displacements and velocities, (body, lane) each
    end: tuple[np.ndarray, np.ndarray]
    length: float  # (s)


class EnergyOfEvents:
    """Which products are integrated in a network, and the powers that follow from them.

    Parameters
    ----------
    model : Model
        The network that is followed; a contact that it has more than the network has no force.
    network : OfNetwork
        What the record knows of the network.
    frequencies : (wave,) ndarray
        Those of the waves, as the pieces have them (rad s-1).
    """

    def __init__(self, model: Model, network: OfNetwork, frequencies: np.ndarray) -> None:
        self.model, self.network, self.frequencies = model, network, frequencies.tolist()
        self.places = np.cumsum(model.bodies.free) - 1  # of free bodies among those that pieces have
        self.given = dict(given_waves(model))
        self.products: dict[tuple[int, int, int, int], int] = {}
        entries, forces = network.accounts.entries, self._forces()
        self.entries = [
            [(-weight * factor, number) for factor, number in self._power(forces[row], slot)]
            for slot, weight, row in zip(*(item.tolist() for item in entries), strict=True)
        ]
        self.drives = self._of_sources()

    @property
    def flows(self) -> np.ndarray:
        """The products, as `impactlab.kernels.from_event_to_event.Scene.flows` has them, (product, 4)."""
        return np.array(list(self.products), dtype=np.int64).reshape(-1, 4)

    def powers(self, found: Integrals) -> Powers:
        """Return the powers in each realization."""
        network, length = self.network, found.length
        lanes, free = found.squares.shape[1], network.free[:, None]
        moved = found.end[0] - found.begin[0]

        def sums(terms: Sequence[Terms]) -> np.ndarray:
            result = np.zeros((len(terms), lanes))
            for row, each in enumerate(terms):
                for weight, number in each:
                    result[row] += weight * (found.products[number] if number >= 0 else moved[-1 - number])
            return result / length

        entries = sums(self.entries)
        damped = network.linear[1][:, None] * found.squares / length
        changes = (network.energies(*found.end) - network.energies(*found.begin)) / length
        stored, kept = np.where(free, changes[: len(free)], 0.0), changes[len(free) :]
        none = np.zeros((0, lanes))
        return self.completed(Powers(none, none, damped, entries, stored, kept), sums(self.drives))

    def completed(self, powers: Powers, forced: np.ndarray) -> Powers:
        """Return powers with those of sources: of given forces, (force, lane), and of given motions."""
        network, accounts = self.network, self.network.accounts
        drives, body = np.zeros((len(accounts.driven), forced.shape[1])), accounts.driven[:, 1]
        drives[network.forced] = forced
        given = ~network.free[body]
        drives[given] = -accounts.on_bodies(powers.entries)[body[given]]
        sources = summed(drives, accounts.driven[:, 0], len(accounts.sources))
        return powers._replace(sources=sources, given=summed(drives, body, len(network.free)))

    def _forces(self) -> list[Factor]:
        """Return the forces of links."""
        accounts = self.network.accounts
        forces: list[Factor] = [{(CONTACT_FORCE, contact): 1.0} for contact in range(len(accounts.contacts))]
        return forces + [self._of_coupling(coupling) for coupling in range(len(accounts.couplings))]

    def _wave(self, wave: Wave, derivative: bool = False) -> Factor:
        """Return a given motion or force, or its derivative."""
        amplitude = 1j * wave.frequency * wave.amplitude if derivative else wave.amplitude
        result = {} if derivative or not wave.constant else {CONSTANT: wave.constant}
        if wave.amplitude:
            place = self.frequencies.index(wave.frequency)
            result |= {(COSINE, place): amplitude.real, (SINE, place): -amplitude.imag}
        return result

    def _motion(self, slot: int, kind: int) -> Factor:
        """Return the displacement or the velocity of a body."""
        if slot in self.given:
            return self._wave(self.given[slot], kind == VELOCITY)
        return {(kind, int(self.places[slot])): 1.0}

    def _power(self, force: Factor, slot: int) -> Terms:
        """Return the terms of the integral of a force times the velocity of a body."""
        result: Terms = []
        for one, weight in force.items():
            if one == CONSTANT:
                result.append((weight, -1 - slot))
                continue
            for other, factor in self._motion(slot, VELOCITY).items():
                number = self.products.setdefault((*one, *other), len(self.products))
                result.append((weight * factor, number))
        return result

    def _of_coupling(self, coupling: int) -> Factor:
        """Return the force of a coupling along its link: of springs and dampers, and of rows that have events."""
        accounts, model, entries = self.network.accounts, self.model, self.network.accounts.entries
        strengths = self.network.couplings[:, coupling] + [inner_springs(model)[coupling], 0.0]
        result: dict[tuple[int, int], float] = {}
        own, chosen = np.zeros(len(model.bodies)), entries.rows == len(accounts.contacts) + coupling
        for slot, weight in zip(entries.slots[chosen].tolist(), entries.weights[chosen].tolist(), strict=True):
            own[slot] += weight
            for strength, kind in zip(strengths.tolist(), (DISPLACEMENT, VELOCITY), strict=True):
                for key, value in self._motion(slot, kind).items() if strength else ():
                    result[key] = result.get(key, 0.0) + strength * weight * value
        rows = rows_of_couplings(model)
        for row, name in enumerate(rows.names):
            if name == accounts.couplings[coupling]:
                result[CONTACT_FORCE, len(model.contacts.names) + row] = float(np.sign(rows.links[row] @ own))
        return result

    def _of_sources(self) -> list[Terms]:
        """Return the terms of given forces times velocities, drive by drive; none of given motions."""
        sources, number, result = self.model.sources["force"], 0, list[Terms]()
        for source, excitation in enumerate(sources.excitations):
            wave = isinstance(excitation, ConstantForce | Harmonic)
            force = self._wave(Wave(*wave_of(excitation))) if wave else {(FUNCTION, number): 1.0}
            number += not wave
            for slot, weight in zip(*(item.tolist() for item in sources.driven(source)), strict=True):
                weighted = {key: weight * value for key, value in force.items()}
                result.append(self._power(weighted, slot) if self.model.bodies.free[slot] else [])
        return result
