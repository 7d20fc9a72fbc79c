"""Which networks have a known stationary law, and why others have none."""

from __future__ import annotations

import math
from collections.abc import Iterator

from impactlab.contact import Contact
from impactlab.coupling import Coupling, LinearCoupling
from impactlab.errors import InvalidInput, NoExactReference
from impactlab.network import Network
from impactlab.reference.gibbs import GibbsLaw
from impactlab.reference.potential import Gap, Potential

_SAME_TEMPERATURE = 1e-9  # relative difference
_REFUSAL = "There is no exact stationary law that is known here:"


def gibbs_laws(network: Network) -> tuple[GibbsLaw, ...]:
    """Return the stationary law of every group of bodies that contacts and couplings connect.

    Raises
    ------
    NoExactReference
        With all reasons, if one of the groups has no law that is known here.
    """
    groups = list(_groups(network))
    reasons = [reason for name in network.oscillators for reason in _body_reasons(network, name)]
    reasons += [reason for item in network.contacts.items() for reason in _contact_reasons(*item)]
    reasons += [reason for item in network.couplings.items() for reason in _coupling_reasons(*item)]
    reasons += [reason for group in groups for reason in _group_reasons(network, *group)]
    if reasons:
        raise NoExactReference("\n- ".join([_REFUSAL, *reasons]))
    return tuple(_law(network, *group) for group in groups)


def _groups(network: Network) -> Iterator[tuple[tuple[str, ...], tuple[Contact, ...]]]:
    """Give the bodies, in order, and the contacts of every connected component."""
    group = {name: frozenset([name]) for name in network.oscillators}
    links: list[Contact | Coupling] = [*network.contacts.values(), *network.couplings.values()]
    for link in links:
        merged = frozenset[str]().union(*(group[name] for name in _sides(link)))
        group.update(dict.fromkeys(merged, merged))
    for members in dict.fromkeys(group.values()):
        bodies = tuple(name for name in network.oscillators if name in members)
        contacts = network.contacts.values()
        yield bodies, tuple(contact for contact in contacts if members.intersection(_sides(contact)))


def _sides(link: Contact | Coupling) -> list[str]:
    """Return the one or two bodies of a contact or a coupling, as sorted names."""
    return sorted(side for side in (link.first, link.second) if isinstance(side, str))


def _coupling_stiffness(network: Network, *bodies: str) -> float:
    """Return the stiffness of the couplings between two bodies, or one and a wall (N m-1)."""
    return sum(item.law.linear[0] for item in network.couplings.values() if _sides(item) == sorted(bodies))


def _stiffness(network: Network, name: str) -> float:
    """Return the stiffness that holds a body to the ground (N m-1)."""
    return network.oscillators[name].stiffness + _coupling_stiffness(network, name)


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


def _group_reasons(network: Network, bodies: tuple[str, ...], contacts: tuple[Contact, ...]) -> Iterator[str]:
    names = " and ".join(map(repr, bodies))
    oscillators = [network.oscillators[name] for name in bodies]
    temperatures = _temperatures(network, bodies)
    if temperatures and _differ(*temperatures.values()):
        shown = ", ".join(f"{name!r} {value:g} J" for name, value in temperatures.items())
        yield f"the temperatures π S / damping of connected bodies differ: {shown}."
    if not any(_spectral_density(network, name) != 0.0 or network.oscillators[name].damping for name in bodies):
        yield f"{names}: neither noise nor damping, the energy stays as it was at the start."
    if len(bodies) > 2:
        yield f"{names} are connected; the law is computed for single bodies and pairs."
    if len(bodies) != 2:
        return
    if any(len(_sides(contact)) == 1 for contact in contacts):
        yield f"{names} are connected and touch a wall; the law of a pair is computed without walls."
    if any(oscillator.has_kernel("residual") for oscillator in oscillators):
        yield f"{names} are connected and not both linear; the law is computed for pairs of linear bodies."
    if not any(_stiffness(network, name) for name in bodies):
        yield f"{names} have no springs: nothing confines their center, the law cannot be normalised."


def _differ(*values: float) -> bool:
    return max(values) - min(values) > _SAME_TEMPERATURE * max(values)


def _law(network: Network, bodies: tuple[str, ...], contacts: tuple[Contact, ...]) -> GibbsLaw:
    """Return the law of a group for which there are no reasons against it."""
    temperatures = _temperatures(network, bodies)
    temperature = next(iter(temperatures.values()))
    gaps = tuple(Gap.of(contact, bodies[0]) for contact in contacts)
    names = " and ".join(map(repr, bodies))
    first = network.oscillators[bodies[0]]
    if len(bodies) == 1:
        residual = first if first.has_kernel("residual") else None
        return GibbsLaw(bodies, Potential(names, temperature, _stiffness(network, bodies[0]), gaps, residual))
    held = [_stiffness(network, name) for name in bodies]
    between = _coupling_stiffness(network, *bodies)
    total = sum(held)
    weights = (held[1] / total, -held[0] / total)
    potential = Potential(names, temperature, held[0] * weights[0] + between, gaps)
    law = GibbsLaw(bodies, potential, weights, math.sqrt(temperature / total))
    if len(temperatures) == 1 and not between and not any(law.mean_force(gap) for gap in gaps):
        cold = next(name for name in bodies if name not in temperatures)
        raise NoExactReference(f"{_REFUSAL}\n- {cold!r} has neither noise nor damping, and nothing heats it.")
    return law
