"""Which networks have a known stationary law, and why others have none."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

from impactlab.contact import Contact
from impactlab.coupling import Coupling, LinearCoupling
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.network import Network
from impactlab.reference.gibbs import GibbsLaw
from impactlab.reference.potential import Gap, Potential
from impactlab.reference.tree import TreeLaw

Law = GibbsLaw | TreeLaw

_SAME_TEMPERATURE = 1e-9  # relative difference
_REFUSAL = "There is no exact stationary law that is known here:"


@dataclass(frozen=True, eq=False)
class _Group:
    """Bodies that contacts and couplings connect."""

    network: Network
    bodies: tuple[str, ...]
    contacts: tuple[Contact, ...]
    couplings: tuple[Coupling, ...]

    @cached_property
    def stiffness(self) -> dict[tuple[str, ...], float]:
        """Stiffness of the couplings between two bodies, and of what holds one to the ground (N m-1)."""
        result: dict[tuple[str, ...], float] = {}
        for name in self.bodies:
            result[name,] = self.network.oscillators[name].stiffness
        for item in self.couplings:
            result[_sides(item)] = result.get(_sides(item), 0.0) + item.law.linear[0]
        return result

    @cached_property
    def touching(self) -> dict[tuple[str, ...], list[Contact]]:
        """Contacts of two bodies, or of one and a wall."""
        result: dict[tuple[str, ...], list[Contact]] = {}
        for contact in self.contacts:
            result.setdefault(_sides(contact), []).append(contact)
        return result

    @cached_property
    def pairs(self) -> list[tuple[str, ...]]:
        """Connected pairs of bodies."""
        return [sides for sides in dict.fromkeys([*self.stiffness, *self.touching]) if len(sides) == 2]

    @property
    def is_simple(self) -> bool:
        """Whether the law is that of a single coordinate."""
        if len(self.bodies) == 1:
            return True
        walled = any(len(sides) == 1 for sides in self.touching)
        bent = any(self.network.oscillators[name].has_kernel("residual") for name in self.bodies)
        return len(self.bodies) == 2 and not walled and not bent

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


def gibbs_laws(network: Network) -> tuple[Law, ...]:
    """Return the stationary law of every group of bodies that contacts and couplings connect.

    Raises
    ------
    NoExactReference
        With all reasons, if one of the groups has no law that is known here.
    """
    groups = _groups(network)
    reasons = [reason for name in network.oscillators for reason in _body_reasons(network, name)]
    reasons += [reason for item in network.contacts.items() for reason in _contact_reasons(*item)]
    reasons += [reason for item in network.couplings.items() for reason in _coupling_reasons(*item)]
    reasons += [reason for group in groups for reason in _group_reasons(group)]
    if reasons:
        raise NoExactReference("\n- ".join([_REFUSAL, *reasons]))
    return tuple(map(_law, groups))


def _groups(network: Network) -> list[_Group]:
    """Return the bodies, in order, the contacts and the couplings of every connected component."""
    leader = {name: name for name in network.oscillators}

    def led(name: str) -> str:
        while leader[name] != name:
            leader[name] = name = leader[leader[name]]
        return name

    links: list[Contact | Coupling] = [*network.contacts.values(), *network.couplings.values()]
    for link in links:
        one, *other = map(led, _sides(link))
        leader[one] = other[0] if other else one
    members: dict[str, tuple[list[str], list[Contact], list[Coupling]]] = {}
    for name in network.oscillators:
        members.setdefault(led(name), ([], [], []))[0].append(name)
    for contact in network.contacts.values():
        members[led(_sides(contact)[0])][1].append(contact)
    for coupling in network.couplings.values():
        members[led(_sides(coupling)[0])][2].append(coupling)
    return [_Group(network, tuple(names), tuple(c), tuple(k)) for names, c, k in members.values()]


def _sides(link: Contact | Coupling) -> tuple[str, ...]:
    """Return the one or two bodies of a contact or a coupling, as sorted names."""
    return tuple(sorted(side for side in (link.first, link.second) if isinstance(side, str)))


def _named(bodies: Sequence[str]) -> str:
    """Return the names of some bodies, of many the first ones."""
    shown = list(map(repr, bodies[: 6 if len(bodies) < 8 else 3]))
    rest = len(bodies) - len(shown)
    return " and ".join([*shown, *([f"{rest} others"] if rest else [])])


def _spectral_density(network: Network, name: str) -> float | None:
    """Return the density S of a body's noise (N2 s rad-1); None if it is not constant white noise."""
    excitation = network.excitations.get(name)
    if excitation is None:
        return 0.0
    if excitation.kind != "intensity" or "time" in excitation.kernel("intensity")[1]:
        return None
    density = float(excitation.call("intensity", 0.0))
    if not 0.0 <= density < math.inf:
        raise InvalidInput(
            f"{type(excitation).__name__}.intensity of {name!r} must be finite and not negative: {density!r}."
        )
    return density


def _temperatures(network: Network, bodies: tuple[str, ...]) -> dict[str, float]:
    """Return ``π S / damping`` (J) of the bodies that have noise and damping."""
    densities = {name: _spectral_density(network, name) for name in bodies}
    dampings = {name: network.oscillators[name].damping for name in bodies}
    return {name: math.pi * S / dampings[name] for name, S in densities.items() if S and dampings[name]}


def _body_reasons(network: Network, name: str) -> Iterator[str]:
    oscillator, density = network.oscillators[name], _spectral_density(network, name)
    if density is None:
        excitation = type(network.excitations[name]).__name__
        yield f"{name!r} is excited by {excitation}; the law is known for constant white noise only."
    elif density and not oscillator.damping:
        yield f"{name!r} has noise without damping and gains energy for ever."
    elif oscillator.damping and not density:
        yield f"{name!r} has damping without noise: its temperature is 0."
    if oscillator.has_kernel("residual"):
        if "velocity" in oscillator.kernel("residual")[1]:
            yield f"the residual force of {name!r} depends on the velocity: it has no potential."
        elif not oscillator.has_kernel("residual_potential"):
            yield f"{type(oscillator).__name__}, the class of {name!r}, does not define residual_potential."


def _contact_reasons(name: str, contact: Contact) -> Iterator[str]:
    if "rate" in contact.law.kernel("force")[1]:
        yield f"the force of contact {name!r} depends on the rate: it has no potential."
    elif not contact.law.has_kernel("potential"):
        yield f"{type(contact.law).__name__}, the law of contact {name!r}, does not define potential."


def _coupling_reasons(name: str, coupling: Coupling) -> Iterator[str]:
    if not isinstance(coupling.law, LinearCoupling):
        yield f"the law of coupling {name!r} is not an il.LinearCoupling."
    elif coupling.law.damping:
        yield f"coupling {name!r} has damping without noise: its temperature is 0."


def _group_reasons(group: _Group) -> Iterator[str]:
    network, bodies = group.network, group.bodies
    temperatures = _temperatures(network, bodies)
    if temperatures and _differ(*temperatures.values()):
        extremes = {choice(temperatures, key=temperatures.__getitem__) for choice in (min, max)}
        names = temperatures if len(temperatures) < 8 else extremes
        shown = ", ".join(f"{name!r} {temperatures[name]:g} J" for name in temperatures if name in names)
        yield f"the temperatures π S / damping of connected bodies differ: {shown}."
    if not any(_spectral_density(network, name) != 0.0 or network.oscillators[name].damping for name in bodies):
        yield f"{_named(bodies)}: neither noise nor damping, the energy stays as it was at the start."
    if len(group.pairs) >= len(bodies):
        yield (
            f"{_named(group.loop)} are connected in loops; the law is computed for trees, such as these bodies "
            "would be with fewer contacts and couplings between them."
        )
    if len(bodies) == 2 and group.is_simple and not any(group.stiffness[name,] for name in bodies):
        yield f"{_named(bodies)} have no springs: nothing confines their center, the law cannot be normalised."


def _differ(*values: float) -> bool:
    return max(values) - min(values) > _SAME_TEMPERATURE * max(values)


def _law(group: _Group) -> Law:
    """Return the law of a group for which there are no reasons against it."""
    temperatures = _temperatures(group.network, group.bodies)
    temperature = next(iter(temperatures.values()))
    law = _gibbs_law(group, temperature) if group.is_simple else _tree_law(group, temperature)
    if len(temperatures) < len(group.bodies):
        _refuse_unheated(group, law, set(temperatures))
    return law


def _gibbs_law(group: _Group, temperature: float) -> GibbsLaw:
    bodies, names = group.bodies, _named(group.bodies)
    gaps = tuple(Gap.of(contact, bodies[0]) for contact in group.contacts)
    if len(bodies) == 1:
        return GibbsLaw(bodies, _own(group, bodies[0], temperature))
    held = [group.stiffness[name,] for name in bodies]
    total = sum(held)
    weights = (held[1] / total, -held[0] / total)
    between = group.stiffness.get(tuple(sorted(bodies)), 0.0)
    potential = Potential(names, temperature, held[0] * weights[0] + between, gaps)
    return GibbsLaw(bodies, potential, weights, math.sqrt(temperature / total))


def _tree_law(group: _Group, temperature: float) -> TreeLaw:
    place = {name: index for index, name in enumerate(group.bodies)}
    links = []
    for pair in group.pairs:
        first, second = sorted(pair, key=place.__getitem__)
        gaps = tuple(Gap.of(contact, first) for contact in group.touching.get(pair, ()))
        potential = Potential(_named((first, second)), temperature, group.stiffness.get(pair, 0.0), gaps)
        links.append((place[first], place[second], potential))
    return TreeLaw(group.bodies, [_own(group, name, temperature) for name in group.bodies], links)


def _own(group: _Group, name: str, temperature: float) -> Potential:
    """Return the potential of a body alone, with its walls."""
    oscillator = group.network.oscillators[name]
    gaps = tuple(Gap.of(contact, name) for contact in group.touching.get((name,), ()))
    residual = oscillator if oscillator.has_kernel("residual") else None
    return Potential(repr(name), temperature, group.stiffness[name,], gaps, residual)


def _refuse_unheated(group: _Group, law: Law, heated: set[str]) -> None:
    """Refuse bodies without noise and damping that no force connects to one that has both."""
    pulling = [pair for pair in group.pairs if group.stiffness.get(pair) or _pushes(group, law, pair)]
    while reached := {name for pair in pulling if heated.intersection(pair) for name in pair} - heated:
        heated |= reached
    cold = [name for name in group.bodies if name not in heated]
    if cold:
        raise NoExactReference(
            "\n- ".join(
                [_REFUSAL, *(f"{name!r} has neither noise nor damping, and nothing heats it." for name in cold)]
            )
        )


def _pushes(group: _Group, law: Law, pair: tuple[str, ...]) -> bool:
    return any(law.contact(contact)[2] for contact in group.touching.get(pair, ()))
