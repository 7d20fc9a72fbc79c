"""Bodies that contacts and couplings connect, and the temperatures of their noises."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from impactlab.assembly.links import Pairs
from impactlab.components.composition import Composition
from impactlab.components.contact import Contact
from impactlab.components.coupling import Coupling, LinearCoupling
from impactlab.components.excitation import Excitation, Source
from impactlab.components.loads import Harmonic
from impactlab.components.modulated import ModulatedExcitation
from impactlab.components.sides import bodies_of
from impactlab.errors import InvalidInput, NoExactReference

SAME_TEMPERATURE = 1e-9
"""Relative difference of two temperatures that are taken to be the same."""

UNHEATED = (
    "neither noise nor damping, the energy stays as it was at the start; with both on one of them there would be a law."
)
_REFUSAL = "There is no exact stationary law that is known here:"


@dataclass(frozen=True, eq=False)
class Subsystem:
    """Bodies that contacts, couplings and sources connect."""

    network: Composition
    bodies: tuple[str, ...]
    contacts: Mapping[str, Contact]
    couplings: Mapping[str, Coupling]

    @cached_property
    def given_motions(self) -> list[str]:
        """Why there is no law where the motion of a body is given; nothing where none is."""
        names = [name for name in self.bodies if self.network.oscillators[name].moves_as_given]
        return [f"{name!r} moves as it is given, so that no law is stationary." for name in names]

    @cached_property
    def stiffness(self) -> dict[tuple[str, ...], float]:
        """Stiffness of the couplings between two bodies, and of what holds one to the ground (N m-1)."""
        result: dict[tuple[str, ...], float] = {}
        for name in self.bodies:
            result[name,] = self.network.oscillators[name].stiffness
        for item in self.couplings.values():
            result[sides(item)] = result.get(sides(item), 0.0) + item.law.linear[0]
        return result

    @cached_property
    def touching(self) -> dict[tuple[str, ...], list[Contact]]:
        """Contacts of two bodies, or of one and a wall."""
        result: dict[tuple[str, ...], list[Contact]] = {}
        for contact in self.contacts.values():
            result.setdefault(sides(contact), []).append(contact)
        return result

    @cached_property
    def springs(self) -> dict[tuple[str, ...], list[Coupling]]:
        """Couplings of two bodies, or of one and the ground, that are not linear."""
        result: dict[tuple[str, ...], list[Coupling]] = {}
        for item in self.couplings.values():
            if not is_linear(item):
                result.setdefault(sides(item), []).append(item)
        return result

    @cached_property
    def pairs(self) -> list[tuple[str, ...]]:
        """Connected pairs of bodies."""
        return [pair for pair in dict.fromkeys([*self.stiffness, *self.touching]) if len(pair) == 2]

    @cached_property
    def bent(self) -> list[str]:
        """The bodies that have a residual force."""
        return [name for name in self.bodies if self.network.oscillators[name].has_kernel("residual")]

    @property
    def is_linear(self) -> bool:
        """Whether nothing is there but linear bodies and couplings."""
        return not self.contacts and not self.bent and all(map(is_linear, self.couplings.values()))

    @property
    def _walled(self) -> bool:
        return any(len(pair) == 1 for pair in self.touching)

    @property
    def is_simple(self) -> bool:
        """Whether the law is that of a single coordinate."""
        held = self._walled or self.bent or any(len(pair) == 1 for pair in self.springs)
        return len(self.bodies) == 1 or (len(self.bodies) == 2 and not held)

    @property
    def is_ring(self) -> bool:
        """Whether each body is connected with the next, the last with the first, and nothing else."""
        return len(self.pairs) == len(self.bodies) == len(self.loop) and not self._walled

    @property
    def ring(self) -> list[str]:
        """The bodies of a ring in its order."""
        result = [self.bodies[0]]
        while len(result) < len(self.bodies):
            near = [name for pair in self.pairs if result[-1] in pair for name in pair]
            result.append(next(name for name in near if name not in result))
        return result

    @property
    def loop(self) -> list[str]:
        """The bodies in loops and between them."""
        around: dict[str, set[str]] = {name: set() for name in self.bodies}
        for one, other in self.pairs:
            around[one].add(other)
            around[other].add(one)
        ends = [name for name, others in around.items() if len(others) < 2]
        for name in ends:
            for other in around.pop(name, ()):
                around[other].discard(name)
                if len(around[other]) == 1:
                    ends.append(other)
        return [name for name, others in around.items() if others]

    @cached_property
    def common_noises(self) -> dict[str, list[str]]:
        """The white noises that drive several of the bodies, and which."""
        sources, inside = self.network.sources.items(), set(self.bodies)
        noises = {name: item.on for name, item in sources if item.excitation.kind == "intensity"}
        of_several = {name: [body for body in on if body in inside] for name, on in noises.items()}
        return {name: bodies for name, bodies in of_several.items() if len(bodies) > 1}

    @cached_property
    def temperatures(self) -> dict[str, float]:
        """``π S / damping`` (J) of the bodies that have noise and damping."""
        densities = {name: spectral_density(self.network, name) for name in self.bodies}
        dampings = {name: self.network.oscillators[name].damping for name in self.bodies}
        return {name: math.pi * S / dampings[name] for name, S in densities.items() if S and dampings[name]}

    def without_contacts(self) -> Composition:
        """Return the bodies with their couplings and excitations only."""
        bodies = {name: self.network.oscillators[name] for name in self.bodies}
        return Composition(bodies, None, self.network.excitations_on(bodies.keys()), self.couplings)


def subsystems_of(network: Composition) -> list[Subsystem]:
    """Return the bodies, in order, the contacts and the couplings of every connected component.

    Couplings of strength 0 connect nothing and are left out.
    """
    acting = {name: item for name, item in network.couplings.items() if not is_linear(item) or any(item.law.linear)}
    slots = {name: slot for slot, name in enumerate(network.oscillators)}
    links: list[Contact | Coupling] = [*network.contacts.values(), *acting.values()]
    together = [*map(sides, links), *(tuple(source.on) for source in network.sources.values()), *_sharing(network)]
    pairs = np.array([[slots[name] for name in pair] for names in together for pair in pairwise(names)], dtype=np.int64)
    part_of = dict(zip(slots, Pairs(len(slots), pairs.reshape(-1, 2)).parts.tolist(), strict=True))
    members: dict[int, tuple[list[str], dict[str, Contact], dict[str, Coupling]]] = {}
    for name, part in part_of.items():
        members.setdefault(part, ([], {}, {}))[0].append(name)
    for name, contact in network.contacts.items():
        members[part_of[sides(contact)[0]]][1][name] = contact
    for name, coupling in acting.items():
        members[part_of[sides(coupling)[0]]][2][name] = coupling
    return [Subsystem(network, tuple(names), contacts, couplings) for names, contacts, couplings in members.values()]


def _sharing(network: Composition) -> list[tuple[str, ...]]:
    """Return the bodies under sums of cosines that share their random phases, or harmonic forces of one frequency."""
    result: dict[str | float, tuple[str, ...]] = {}
    for name, item in network.excitations.items():
        excitation, on = (item.excitation, tuple(item.on)) if isinstance(item, Source) else (item, (name,))
        together = excitation.frequency if isinstance(excitation, Harmonic) else excitation.phases_of
        if together is not None:
            result[together] = (*result.get(together, ()), *on)
    return list(result.values())


def is_linear(coupling: Coupling) -> bool:
    """Whether a coupling is a spring and damper."""
    return isinstance(coupling.law, LinearCoupling)


def differ(*temperatures: float) -> bool:
    """Whether some temperatures are not the same."""
    return max(temperatures) - min(temperatures) > SAME_TEMPERATURE * max(temperatures)


def refusal(reasons: Sequence[str]) -> NoExactReference:
    """Return the error that gives some reasons."""
    return NoExactReference("\n- ".join([_REFUSAL, *reasons]))


def sides(link: Contact | Coupling) -> tuple[str, ...]:
    """Return the bodies of a contact or a coupling, as sorted names."""
    return tuple(sorted(bodies_of(link)))


def listed(bodies: Sequence[str]) -> str:
    """Return the names of some bodies, of many the first ones."""
    shown = list(map(repr, bodies[: 6 if len(bodies) < 8 else 3]))
    rest = len(bodies) - len(shown)
    return " and ".join([*shown, *([f"{rest} others"] if rest else [])])


def spectral_density(network: Composition, name: str) -> float | None:
    """Return the density S of a body's noise (N2 s rad-1); None if it is not constant white noise."""
    total = 0.0
    for source, excitation, weight in network.excitations_of(name):
        if not is_steady_noise(excitation):
            return None
        density = float(excitation.call("intensity", 0.0))
        if not 0.0 <= density < math.inf:
            raise InvalidInput(
                f"{type(excitation).__name__}.intensity of {source!r} must be finite and not negative, not {density!r}."
            )
        total += weight**2 * density
    return total


def is_stationary(excitation: Excitation) -> bool:
    """Whether an excitation is a stationary process."""
    if excitation.kind in ("intensity", "force"):
        return is_steady_noise(excitation)
    return excitation.kind == "lines" or not excitation.has_kernel("modulation")


def is_enveloped(excitation: Excitation) -> bool:
    """Whether an excitation is noise with an envelope that is linear between samples."""
    return isinstance(excitation, ModulatedExcitation) and excitation.kind != "force"


def is_steady_noise(excitation: Excitation) -> bool:
    """Whether an excitation is white noise of constant density."""
    return excitation.kind == "intensity" and "time" not in excitation.kernel("intensity")[1]
