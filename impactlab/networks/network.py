"""Networks: a composition of members that can be compiled and checked, and rows of bodies."""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Self

import impactlab
from impactlab.components.composition import Composition
from impactlab.components.contact import ContactLaw, contacts_between
from impactlab.components.excitation import Excitation
from impactlab.components.oscillator import Oscillator
from impactlab.components.sides import WALL
from impactlab.errors import InvalidInput
from impactlab.inputs import Count, Text, checked, shown
from impactlab.machine import uncollected

if TYPE_CHECKING:
    from impactlab import CompiledNetwork, Integrator, NetworkCheck, Uncertain


LONGEST_CHAIN = 100_000_000
"""Bodies of a chain beyond which their names alone take the memory of any machine."""


@checked
class Network(Composition):
    """Bodies that can touch each other, may be coupled, and are excited from outside; immutable.

    Two networks are equal when they have the same members of the same names in the same
    order, which is that of the results.

    Parameters
    ----------
    oscillators : mapping of str to Oscillator
        The bodies by name (a sequence of pairs will do as well).
    contacts : mapping of str to Contact, optional
        The places where bodies can touch, by name.
    excitations : mapping of str to Excitation, Source or BaseMotion, optional
        The excitation of a body, by the body's name; and excitations of several bodies, or more of one, or motions of
        the ground, by names of their own.
    couplings : mapping of str to Coupling, optional
        Springs and dampers between bodies, by name.

    Raises
    ------
    InvalidInput
        If there are no bodies, a name is empty or given twice, a contact, a coupling or an
        excitation names a body that does not exist, a member is of the wrong family, or a potential
        is not the integral of its force.

    Examples
    --------
    >>> print(network)
    Network: 1 body, 1 contact, 1 excitation
      oscillators
        a: LinearOscillator(damping=0.5, stiffness=10.0)
      contacts
        stop: Contact('a', WALL, HertzContact(stiffness=10000.0), clearance=0.1)
      excitations
        a: WhiteNoise(spectral_density=1.0)
    >>> apart = network.replace(contacts={"stop": None})
    >>> len(apart.contacts)
    0
    """

    __slots__ = ()

    def compile(self) -> CompiledNetwork:
        """Compile the network's forces and return its noise-free right-hand side."""
        return impactlab.CompiledNetwork(self)

    def check(self, step: float | None = None, integrator: Integrator | None = None) -> NetworkCheck:
        """Find the network's time scales and predict the bias of a step, without simulating.

        Parameters
        ----------
        step : float, optional
            Time step (s); by default the one that `simulate` would choose before it makes it
            divide the duration. Of forces that vary in time the first twelve relaxation times
            are looked at.
        integrator : Integrator, optional
            Method; `ExactFlow` by default.

        Returns
        -------
        NetworkCheck
            Prints a table; its ``dataset`` has the numbers.

        Raises
        ------
        InvalidInput
            If the step or the integrator cannot be used; with the words of `simulate`.
        """
        return impactlab.NetworkCheck.of(self, step, integrator)

    def to_toml(self) -> str:
        """Return the network as a text in TOML that people can read, with units; :meth:`from_toml` makes it again.

        It has a table for each body, contact, excitation and coupling, ``[oscillators.name]``, with the name of
        its class as ``type`` and its fields, and a table below for a law, ``[contacts.name.law]``.
        """
        from impactlab.networks.network_file import text_of  # loaded only where there are files

        return text_of(self)

    @classmethod
    def from_toml(cls, source: Text | os.PathLike[str]) -> Self:
        """Make a network from what :meth:`to_toml` returned, or what somebody wrote.

        Parameters
        ----------
        source : path or str
            A file; or the text itself, of more than one line. A table ``simulate``, with options for
            the command line, is left out.

        Raises
        ------
        InvalidInput
            If the network cannot be made; the message names the line.
        """
        from impactlab.networks.network_file import NetworkFile

        network: Self = NetworkFile.read(source).network(cls)
        return network

    def source(self) -> str:
        """Return the text of the module that is generated for this network."""
        from impactlab.assembly.generate import generate
        from impactlab.assembly.model import Model

        return generate(Model.of(self))

    def _repr_html_(self) -> str:
        return impactlab.plot.network_html(self)


@checked
@uncollected()
def chain(
    bodies: Count,
    oscillator: Oscillator | Sequence[Oscillator],
    law: ContactLaw | Sequence[ContactLaw],
    *,
    clearance: float | Uncertain | Sequence[float | Uncertain] = 0.0,
    excitation: Excitation | Sequence[Excitation | None] | None = None,
    walls: bool = False,
) -> Network:
    """Return a network of bodies in a row, where neighbours can touch.

    Parameters
    ----------
    bodies : int
        Number of bodies; they are named ``body_0``, ``body_1``, …
    oscillator : Oscillator or sequence
        One for all bodies, or one for each.
    law : ContactLaw or sequence
        One for all contacts (named ``contact_0``, …, from left to right), or one for each.
    clearance : float or sequence
        Clearance of the contacts (m).
    excitation : Excitation or sequence, optional
        One for all bodies (their noises are independent), or one or None for each.
    walls : bool
        Whether the first body can touch a wall on its left and the last on its right.

    Returns
    -------
    Network

    Raises
    ------
    InvalidInput
        If the number of bodies is not positive or a sequence has the wrong length.

    Examples
    --------
    >>> row = il.chain(3, il.LinearOscillator(stiffness=10.0), il.HertzContact(1e4), walls=True)
    >>> list(row.contacts)
    ['contact_0', 'contact_1', 'contact_2', 'contact_3']
    """
    if bodies > LONGEST_CHAIN:
        raise InvalidInput(f"chain: bodies must be {LONGEST_CHAIN} at most, not {shown(bodies)}.")
    names = [f"body_{index}" for index in range(bodies)]
    ends: list[Any] = [WALL, *names, WALL] if walls else list(names)
    pairs = list(pairwise(ends))
    oscillators = _each("oscillator", oscillator, bodies)
    excitations = _each("excitation", excitation, bodies)
    contacts = contacts_between(pairs, _each("law", law, len(pairs)), _each("clearance", clearance, len(pairs)))
    return Network(
        dict(zip(names, oscillators, strict=True)),
        {f"contact_{index}": contact for index, contact in enumerate(contacts)},
        {name: item for name, item in zip(names, excitations, strict=True) if item is not None},
    )


def _each(name: str, value: Any, count: int) -> list[Any]:
    """Return one value per place, from one for all or a sequence of the right length."""
    if not isinstance(value, Sequence):
        return [value] * count
    if len(value) != count:
        raise InvalidInput(f"chain: {name} must be a single one for all or a sequence of {count}, not of {len(value)}.")
    return list(value)
