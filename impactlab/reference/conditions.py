"""Which networks have a known stationary law, and why others have none."""

from __future__ import annotations

import math
from collections.abc import Iterator

from impactlab.components.component import Component
from impactlab.components.composition import Composition
from impactlab.components.contact import Contact
from impactlab.components.coupling import Coupling
from impactlab.components.evaluation import TIME
from impactlab.components.sides import is_difference, is_round
from impactlab.reference.combination import CombinationPart
from impactlab.reference.gaussian import GaussianLaw
from impactlab.reference.gibbs import GibbsLaw
from impactlab.reference.linear_laws import Apart, LinearPart
from impactlab.reference.potential import Gap, Potential, Spring
from impactlab.reference.ring import RingLaw
from impactlab.reference.subsystems import (
    UNHEATED,
    Subsystem,
    differ,
    is_linear,
    is_steady_noise,
    listed,
    refusal,
    sides,
    spectral_density,
    subsystems_of,
)
from impactlab.reference.tree import TreeLaw

Law = GibbsLaw | TreeLaw | RingLaw | GaussianLaw

_WEIGHTED = (
    "acts on a combination with weights; with contacts the law is computed for differences of two bodies, or of a body "
    "and a wall, or for linear bodies whose contacts all act along one combination."
)
_TIMED = "depends on time, so that no law is stationary."
_FORCED = "a contact or a coupling that pushes it would."


def laws_of(network: Composition) -> tuple[tuple[Law, ...], frozenset[str]]:
    """Return the laws of the independent parts of a network, and the contacts that are left out since they never close.

    If one of the parts has no law that is known here it is refused with all reasons.
    """
    laws, untouched, reasons = _judged(network)
    if reasons:
        raise refusal(reasons)
    return tuple(_gibbs_law(item) if isinstance(item, Subsystem) else item for item in laws), untouched


def reasons_of(network: Composition) -> list[str]:
    """Say why no exact stationary law is known, part by part; nothing if one is."""
    return _judged(network)[2]


def _judged(network: Composition) -> tuple[list[Law | Subsystem], frozenset[str], list[str]]:
    """Return laws, or parts whose density is ``exp(−H/T)``, contacts that are left out, and reasons against a law."""
    laws: list[Law | Subsystem] = []
    reasons: list[str] = []
    untouched: frozenset[str] = frozenset()
    for subsystem in subsystems_of(network):
        if subsystem.given_motions:
            reasons += subsystem.given_motions
            continue
        if subsystem.is_linear:
            part = LinearPart(subsystem)
            why = part.reasons
            laws += [] if why else [part.law]
        elif why := list(_round_reasons(subsystem)):
            reasons += why
            continue
        elif why := list(_gibbs_reasons(subsystem)):
            along = CombinationPart(subsystem)
            of_combination = list(_combination_reasons(along)) if along.fits else why
            if not of_combination:
                laws.append(along.law)
                continue
            why = of_combination if _needs_combination(subsystem) else why
            apart = Apart.of(subsystem)
            if apart is not None and not apart.mattering:
                laws += apart.laws
                untouched = untouched.union(subsystem.contacts)
                why = []
            elif apart is not None:
                why.append(apart.advice)
        else:
            laws.append(subsystem)
        reasons += why
    return laws, untouched, reasons


def _round_reasons(subsystem: Subsystem) -> Iterator[str]:
    """Say which contacts act in a plane, where densities of two displacements at a time would be needed."""
    for name, contact in subsystem.contacts.items():
        if is_round(contact):
            yield f"{name!r} is a round contact; laws are known for contacts along one direction."


def _gibbs_reasons(subsystem: Subsystem) -> Iterator[str]:
    """Say why the density of a subsystem is not known to be ``exp(−H/T)``."""
    for name in subsystem.bodies:
        yield from _body_reasons(subsystem, name)
    for name, contact in subsystem.contacts.items():
        yield from _contact_reasons(name, contact)
    for name, coupling in subsystem.couplings.items():
        yield from _coupling_reasons(name, coupling)
    yield from _subsystem_reasons(subsystem)


def _needs_combination(subsystem: Subsystem) -> bool:
    """Whether a law along a combination is the only one that there may be."""
    links = [*subsystem.contacts.values(), *subsystem.couplings.values()]
    return not all(map(is_difference, links))


def _combination_reasons(part: CombinationPart) -> Iterator[str]:
    """Say why the bodies of a subsystem with contacts along one combination have no law."""
    subsystem = part.subsystem
    varying = [name for name in subsystem.bodies if spectral_density(subsystem.network, name) is None]
    if varying:
        yield f"{listed(varying)}: the law is known for constant white noise only."
    for name, contact in subsystem.contacts.items():
        yield from _contact_law_reasons(name, contact)
    yield from () if varying else part.reasons()


def _body_reasons(subsystem: Subsystem, name: str) -> Iterator[str]:
    network = subsystem.network
    oscillator, density = network.oscillators[name], spectral_density(network, name)
    known = next(iter(subsystem.temperatures.values()), None)
    if density is None:
        others = [item for _, item, _ in network.excitations_of(name) if not is_steady_noise(item)]
        excitation = type(others[0]).__name__
        cure = f"il.WhiteNoise({oscillator.damping * known / math.pi:.6g})" if known else "il.WhiteNoise"
        yield f"{name!r} is excited by {excitation}; the law is known for constant white noise only, as {cure}."
    elif density and not oscillator.damping:
        cure = f"damping {math.pi * density / known:.6g} N s m-1" if known else "damping"
        if _slowed(subsystem, name):
            yield f"{name!r} has noise without linear damping of its own, and no temperature; it would need {cure}."
        else:
            yield f"{name!r} has noise without damping and gains energy for ever; with {cure} it would have a law."
    elif oscillator.damping and not density:
        cure = f"S = {oscillator.damping * known / math.pi:.6g} N2 s rad-1" if known else "white noise"
        yield f"{name!r} has damping without noise: its temperature is 0; with {cure} it would have a law."
    if oscillator.has_kernel("residual"):
        kind = type(oscillator).__name__
        if oscillator.state_names():
            yield _with_states(f"the residual force of {name!r}", oscillator)
        elif TIME in oscillator.arguments("residual")[0]:
            yield f"the residual force of {name!r} {_TIMED}"
        elif "velocity" in oscillator.kernel("residual")[1]:
            yield (
                f"the residual force of {name!r} depends on the velocity: it has no potential; one that depends on "
                "the displacement only, with residual_potential(displacement, ...), would do."
            )
        elif not oscillator.has_kernel("residual_potential"):
            yield (
                f"{kind}, the class of {name!r}, does not define residual_potential; define "
                f"residual_potential(displacement, ...), the integral of {kind}.residual from 0."
            )


def _slowed(subsystem: Subsystem, body: str) -> bool:
    """Whether forces that depend on velocities or the past act on a body, beside its own damping."""
    oscillator = subsystem.network.oscillators[body]
    if oscillator.has_kernel("residual") and "velocity" in oscillator.kernel("residual")[1]:
        return True
    laws = [item.law for item in subsystem.couplings.values() if body in sides(item)]
    touching = [item.law for item in subsystem.contacts.values() if body in sides(item)]
    lossy = [law for law in touching if law.state_names() or "rate" in law.kernel("force")[1]]
    return bool(lossy) or any(law.dissipative for law in laws)


def _contact_reasons(name: str, contact: Contact) -> Iterator[str]:
    yield from _contact_law_reasons(name, contact)
    if not is_difference(contact):
        yield f"contact {name!r} {_WEIGHTED}"


def _contact_law_reasons(name: str, contact: Contact) -> Iterator[str]:
    kind = type(contact.law).__name__
    if contact.law.impulsive and contact.law.restitution_at(1.0, 1.0) < 1.0:
        yield f"impacts of contact {name!r} take energy; with restitution=1 the law would be known."
    if contact.law.state_names():
        yield _with_states(f"the force of contact {name!r}", contact.law)
    elif TIME in contact.law.arguments("force")[0]:
        yield f"the force of contact {name!r} {_TIMED}"
    elif "rate" in contact.law.kernel("force")[1]:
        yield (
            f"the force of contact {name!r} depends on the rate: it has no potential; a law of the indentation alone, "
            "with potential(indentation, ...), would do."
        )
    elif not contact.law.has_kernel("potential"):
        yield (
            f"{kind}, the law of contact {name!r}, does not define potential; define potential(indentation, ...), "
            f"the integral of {kind}.force from 0."
        )


def _coupling_reasons(name: str, coupling: Coupling) -> Iterator[str]:
    if coupling.law.state_names():
        yield _with_states(f"the force of coupling {name!r}", coupling.law)
    elif TIME in coupling.law.arguments("force")[0]:
        yield f"the force of coupling {name!r} {_TIMED}"
    elif "rate" in coupling.law.kernel("force")[1] and not is_linear(coupling):
        yield f"the force of coupling {name!r} depends on the rate without noise of its own: it has no temperature."
    elif not is_linear(coupling) and not coupling.law.has_kernel("potential"):
        kind = type(coupling.law).__name__
        yield (
            f"{kind}, the law of coupling {name!r}, does not define potential; define potential(extension, ...), the "
            f"integral of {kind}.force from 0."
        )
    elif coupling.law.linear[1]:
        yield f"coupling {name!r} has damping without noise: its temperature is 0; with damping=0 it would do."
    if not is_difference(coupling):
        yield f"coupling {name!r} {_WEIGHTED}"


def _with_states(what: str, law: Component) -> str:
    return f"{what} depends on the past, by the states of {type(law).__name__} ({', '.join(law.state_names())})."


def _subsystem_reasons(subsystem: Subsystem) -> Iterator[str]:
    network, bodies = subsystem.network, subsystem.bodies
    temperatures = subsystem.temperatures
    for source, driven in subsystem.common_noises.items():
        yield (
            f"one noise, {source!r}, drives {listed(driven)}: their motions are correlated, and the density is not "
            "exp(−H/T); a noise of its own on each would do."
        )
    if not subsystem.common_noises and temperatures and differ(*temperatures.values()):
        yield _unequal(subsystem)
    if not any(spectral_density(network, name) != 0.0 or network.oscillators[name].damping for name in bodies):
        yield f"{listed(bodies)}: {UNHEATED}"
    impulsive = [name for name, contact in subsystem.contacts.items() if contact.law.impulsive]
    if impulsive and not subsystem.is_simple:
        yield (
            f"{listed(impulsive)}: with impulsive contacts the law is computed for a body, for two linear bodies "
            "without other contacts of theirs, or along one combination; with il.LinearContact it would be known."
        )
    if len(subsystem.pairs) >= len(bodies) and not subsystem.is_ring:
        yield (
            f"{listed(subsystem.loop)} are connected in loops; the law is computed for trees, such as these bodies "
            "would be with fewer contacts and couplings between them, and for a ring alone, without branches and walls."
        )
    if len(bodies) == 2 and subsystem.is_simple and not any(subsystem.stiffness[name,] for name in bodies):
        yield (
            f"{listed(bodies)} have no springs: nothing confines their center, the law cannot be normalised; a spring "
            "on one of them would do."
        )


def _unequal(subsystem: Subsystem) -> str:
    """Say which temperatures differ, and which noises would make them equal."""
    temperatures = subsystem.temperatures
    target = next(iter(temperatures.values()))
    others = [name for name, value in temperatures.items() if differ(value, target)]
    names = temperatures if len(temperatures) < 8 else [next(iter(temperatures)), *others[:3]]
    shown = ", ".join(f"{name!r} {temperatures[name]:g} J" for name in names)
    needed = {name: subsystem.network.oscillators[name].damping * target / math.pi for name in others[:3]}
    cure = " and ".join(f"S = {value:.6g} N2 s rad-1 on {name!r}" for name, value in needed.items())
    rest = f" and so on for {len(others) - 3} more" if len(others) > 3 else ""
    return f"the temperatures π S / damping of connected bodies differ: {shown}; with {cure}{rest} they would be equal."


def _gibbs_law(subsystem: Subsystem) -> GibbsLaw | TreeLaw | RingLaw:
    """Return the law of a subsystem for which there are no reasons against it."""
    temperature = next(iter(subsystem.temperatures.values()))
    make = pair_law if subsystem.is_simple else ring_law if subsystem.is_ring else tree_law
    law = make(subsystem, temperature)
    if len(subsystem.temperatures) < len(subsystem.bodies):
        _refuse_unheated(subsystem, law, set(subsystem.temperatures))
    return law


def pair_law(subsystem: Subsystem, temperature: float) -> GibbsLaw:
    """Return the law of a body or of a pair of linear bodies, by one integral."""
    bodies, names = subsystem.bodies, listed(subsystem.bodies)
    gaps = tuple(Gap.of(contact, bodies[0]) for contact in subsystem.contacts.values())
    if len(bodies) == 1:
        return GibbsLaw(bodies, _own(subsystem, bodies[0], temperature))
    held = [subsystem.stiffness[name,] for name in bodies]
    total = sum(held)
    weights = (held[1] / total, -held[0] / total)
    between = subsystem.stiffness.get(tuple(sorted(bodies)), 0.0)
    springs = _springs(subsystem, tuple(sorted(bodies)), bodies[0])
    potential = Potential(names, temperature, held[0] * weights[0] + between, gaps, springs)
    return GibbsLaw(bodies, potential, weights, math.sqrt(temperature / total))


def tree_law(subsystem: Subsystem, temperature: float) -> TreeLaw:
    """Return the law of bodies in a tree, by transfer integrals."""
    place = {name: index for index, name in enumerate(subsystem.bodies)}
    links = []
    for pair in subsystem.pairs:
        first, second = sorted(pair, key=place.__getitem__)
        links.append((place[first], place[second], _between(subsystem, (first, second), temperature)))
    return TreeLaw(subsystem.bodies, [_own(subsystem, name, temperature) for name in subsystem.bodies], links)


def ring_law(subsystem: Subsystem, temperature: float) -> RingLaw:
    """Return the law of bodies in a ring."""
    ring = subsystem.ring
    links = [_between(subsystem, pair, temperature) for pair in zip(ring, [*ring[1:], ring[0]], strict=True)]
    return RingLaw(tuple(ring), [_own(subsystem, name, temperature) for name in ring], links)


def _between(subsystem: Subsystem, pair: tuple[str, str], temperature: float) -> Potential:
    """Return the potential of the difference of two bodies."""
    ends = tuple(sorted(pair))
    gaps = tuple(Gap.of(contact, pair[0]) for contact in subsystem.touching.get(ends, ()))
    springs = _springs(subsystem, ends, pair[0])
    return Potential(listed(pair), temperature, subsystem.stiffness.get(ends, 0.0), gaps, springs)


def _springs(subsystem: Subsystem, ends: tuple[str, ...], body: str) -> tuple[Spring, ...]:
    """Return the couplings between two bodies, or of one and the ground, that are not linear, as one of them moves."""
    return tuple(Spring.of(coupling, body) for coupling in subsystem.springs.get(ends, ()))


def _own(subsystem: Subsystem, name: str, temperature: float) -> Potential:
    """Return the potential of a body alone, with its walls."""
    oscillator = subsystem.network.oscillators[name]
    gaps = tuple(Gap.of(contact, name) for contact in subsystem.touching.get((name,), ()))
    residual = (Spring(oscillator),) if oscillator.has_kernel("residual") else ()
    springs = residual + _springs(subsystem, (name,), name)
    return Potential(repr(name), temperature, subsystem.stiffness[name,], gaps, springs)


def _refuse_unheated(subsystem: Subsystem, law: GibbsLaw | TreeLaw | RingLaw, heated: set[str]) -> None:
    """Refuse bodies without noise and damping that no force connects to one that has both."""
    pulling = [
        pair
        for pair in subsystem.pairs
        if subsystem.stiffness.get(pair) or _pulls(subsystem, pair) or _pushes(subsystem, law, pair)
    ]
    while reached := {name for pair in pulling if heated.intersection(pair) for name in pair} - heated:
        heated |= reached
    cold = [name for name in subsystem.bodies if name not in heated]
    if cold:
        raise refusal([f"{name!r} has neither noise nor damping, and nothing heats it; {_FORCED}" for name in cold])


def _pulls(subsystem: Subsystem, pair: tuple[str, ...]) -> bool:
    return any(item.law.call("potential", place) for item in subsystem.springs.get(pair, ()) for place in (-1.0, 1.0))


def _pushes(subsystem: Subsystem, law: GibbsLaw | TreeLaw | RingLaw, pair: tuple[str, ...]) -> bool:
    return any(law.contact(contact)[2] for contact in subsystem.touching.get(pair, ()))
