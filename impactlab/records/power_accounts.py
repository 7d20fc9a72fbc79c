"""Accounts of energy: what sources give, what each link gives to each body, what is lost and what is stored."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np

from impactlab.assembly.links import Links
from impactlab.assembly.model import Model
from impactlab.results.labels import Variables, with_error
from impactlab.results.schema import BODY, CONTACT, Estimate

COUPLING, SOURCE = "coupling", "source"
"""Dimensions of couplings, and of excitations and given motions."""

BALANCE = "balance"
"""In the place of a dimension: balances of bodies, of which one is no control of itself."""


class Entries(NamedTuple):
    """Bodies on links, one link after the other, (entry,) each; a force F along a link pushes a body by −w F."""

    slots: np.ndarray
    weights: np.ndarray
    rows: np.ndarray  # link of each: contacts, then couplings

    @classmethod
    def of(cls, contacts: Links, couplings: Links) -> Self:
        """Return the bodies of contacts, then of couplings; walls do not move, and take no energy."""
        first, second = contacts.moving(), couplings.moving()
        both = (np.concatenate(pair) for pair in zip(first, (*second[:2], second[2] + len(contacts)), strict=True))
        return cls(*both)


class Powers(NamedTuple):
    """Powers in independent units, (row, unit) each (W)."""

    sources: np.ndarray  # of each source, on the network
    given: np.ndarray  # (body, unit) of all sources, on each body
    damped: np.ndarray  # (body, unit) what dampers and residual forces take, less what these store
    entries: np.ndarray  # (entry, unit) what links give to bodies
    stored: np.ndarray  # (body, unit) rate of change of kinetic and potential energy
    kept: np.ndarray  # (link, unit) the same of the potential energy of links
    sampled: np.ndarray | None = None  # (drive,) error of sampling the powers of given forces at steps


@dataclass(frozen=True, eq=False)
class Accounts:
    """The parts of a network among which energy passes."""

    bodies: tuple[str, ...]
    contacts: tuple[str, ...]
    couplings: tuple[str, ...]
    sources: tuple[str, ...]
    driven: np.ndarray  # (drive, 2) source and body of each
    entries: Entries

    @classmethod
    def of(cls, model: Model) -> Self:
        """Return the parts of a model; a given motion is a source, under the name of its body."""
        names: list[str] = []
        driven: list[tuple[int, int]] = []
        for kind in model.sources.values():
            first = len(names)
            names += kind.names
            driven += [(first + source, body) for source, body in zip(*kind.drives[:2], strict=True)]
        entries = Entries.of(model.ends, model.coupled)
        pairs = np.array(driven, dtype=np.int64).reshape(-1, 2)
        return cls(model.bodies.names, model.contacts.names, model.couplings.names, tuple(names), pairs, entries)

    @property
    def links(self) -> int:
        """Number of contacts and couplings."""
        return len(self.contacts) + len(self.couplings)

    def on_bodies(self, values: np.ndarray) -> np.ndarray:
        """Return sums of values of entries over each body, (body, unit)."""
        return summed(values, self.entries.slots, len(self.bodies))

    def with_losses(self, entries: np.ndarray, kept: np.ndarray, losses: np.ndarray) -> np.ndarray:
        """Return what links give to bodies where losses, (link, unit), are known; all ends of a link share the rest."""
        rows = self.entries.rows
        lost = np.nan_to_num(-summed(entries, rows, self.links) - kept - losses)
        return np.asarray(entries + (lost / np.bincount(rows, minlength=self.links)[:, None])[rows])

    def carried(self, entries: np.ndarray) -> np.ndarray:
        """Return the power from the first to the second side of each link, the mean of what is given and what arrives.

        Nothing is carried to a wall.
        """
        first = self.entries.weights > 0.0
        rows, count = self.entries.rows, self.links
        both = np.bincount(rows[first], minlength=count).clip(max=1) * np.bincount(rows[~first], minlength=count)
        signs = np.where(first, -0.5, 0.5)[:, None]
        return np.where(both[:, None] > 0, summed(signs * entries, rows, count), 0.0)

    def balance(self, powers: Powers) -> np.ndarray:
        """Return the power into each body, less what it loses, passes on and stores, (body, unit)."""
        return np.asarray(powers.given + self.on_bodies(powers.entries) - powers.damped - powers.stored)

    def near(self) -> dict[str, np.ndarray]:
        """Return pairs of a row and a body whose balance tells of it, by the dimension of the row."""
        rows, slots = self.entries.rows, self.entries.slots
        contact = rows < len(self.contacts)
        bodies = np.arange(len(self.bodies))
        of_links = np.stack([rows, slots], axis=1)
        return {
            SOURCE: self.driven,
            BODY: np.stack([bodies, bodies], axis=1),
            CONTACT: of_links[contact],
            COUPLING: of_links[~contact] - [len(self.contacts), 0],
        }


def summed(values: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Return sums of (entry, unit) values over the entries of each row, (row, unit)."""
    result = np.zeros((count, values.shape[1]))
    np.add.at(result, rows, values)
    return result


Average = Callable[[np.ndarray, str], Estimate]
"""Estimates the mean of each row of (row, unit) numbers, which have a dimension, or none."""


def labelled_powers(accounts: Accounts, powers: Powers, comment: str, average: Average) -> Variables:
    """Return the variables of a run, and the coordinates of sources and couplings."""
    contacts, count = len(accounts.contacts), accounts.links
    absorbed = -summed(powers.entries, accounts.entries.rows, count)
    lost, carried = absorbed - powers.kept, accounts.carried(powers.entries)
    balance = accounts.balance(powers)
    sampled = np.zeros(len(accounts.driven)) if powers.sampled is None else powers.sampled
    beside = {
        name: np.sqrt(summed(sampled[:, None] ** 2, accounts.driven[:, side], count)[:, 0])
        for name, side, count in (("power_in", 0, len(accounts.sources)), ("power_balance", 1, len(accounts.bodies)))
    }
    whole = sum(item.sum(axis=0) for item in (powers.sources, -powers.damped, -lost, -powers.stored, -powers.kept))
    of_links = {"dissipated": lost, "carried": carried, "stored": powers.kept}
    texts = {
        "dissipated": "mean power that a {} loses",
        "carried": "mean power carried by a {} from its first to its second side",
        "stored": "rate of change of the energy stored in a {}",
    }
    rows: list[tuple[str, str, np.ndarray, str]] = [
        ("power_in", SOURCE, powers.sources, "mean power that a source gives to the network"),
        ("power_dissipated", BODY, powers.damped, "mean power that the damping of an oscillator takes"),
        ("power_stored", BODY, powers.stored, "rate of change of the energy of an oscillator"),
        ("power_balance", BODY, balance, "power into an oscillator, less what it loses, passes on and stores"),
    ]
    for dimension, part in ((CONTACT, slice(contacts)), (COUPLING, slice(contacts, count))):
        rows += [
            (f"{dimension}_power_{name}", dimension, values[part], texts[name].format(dimension))
            for name, values in of_links.items()
        ]
    names = {SOURCE: accounts.sources, COUPLING: accounts.couplings, CONTACT: accounts.contacts, BODY: accounts.bodies}
    variables: Variables = {
        name: ((name,), np.array(names[name]), {"long_name": f"name of the {name}"})
        for name in (SOURCE, COUPLING)
        if names[name]
    }
    for name, dimension, values, text in rows:
        if names[dimension]:
            near = BALANCE if name == "power_balance" else dimension  # which is no control of itself
            value, error = average(values, near)
            error = np.hypot(error, beside.get(name, 0.0))
            variables |= with_error(name, (dimension,), value, error, "W", text)
    if accounts.sources and comment:
        variables["power_in"][2]["comment"] = comment
    value, error = average(np.atleast_2d(whole), "")
    error = np.hypot(error, np.sqrt((sampled**2).sum()))
    text = "power into the network, less what it loses and stores"
    return variables | with_error("network_power_balance", (), value[0], error[0], "W", text)


def temperature(mass: np.ndarray, square: Estimate) -> Variables:
    """Return the temperatures of bodies, from their masses and mean square velocities."""
    text = "temperature m E[v2], twice the mean kinetic energy"
    return with_error("temperature", (BODY,), mass * square.value, mass * square.error, "J", text)
