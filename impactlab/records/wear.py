"""Records of the work that contacts do on their surfaces, by which they wear."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from impactlab.assembly.links import Links, RoundLinks
from impactlab.assembly.model import Model
from impactlab.components.contact import Contact, RoundContact
from impactlab.components.fields import parameter
from impactlab.components.literature import article
from impactlab.errors import InvalidInput, warn
from impactlab.plan.plan import Plan
from impactlab.records.record import Keeper, Record, names_of
from impactlab.records.recorded_run import RecordedRun
from impactlab.results.labels import Variables, with_error
from impactlab.results.schema import CONTACT
from impactlab.results.snapshot import places_of

MOST_HELD = 0.2
"""Part of the sliding velocity, weighted by work, that friction may take away within a step.

Work rates of a tube in its support were right within 2 % there, and 8 to 15 % too large at 0.6 to 0.7.
"""


class Wear(Record):
    """Work rates of contacts, and the depth that they wear.

    The work rate of a round contact is the mean of ``|F s|``, F being the force along the radius and s the sliding
    velocity across it, with that of the surface; of another contact it is the mean of ``F max(δ', 0)``, the work while
    the contact is being closed. By the law of Archard the depth grows by the coefficient times the work rate.

    Where friction nearly holds the bodies, a step that is too long can make the work rate too large; a warning then
    names a step that is short enough.

    Parameters
    ----------
    contacts : sequence of str, optional
        Contacts; by default all that have a force.
    coefficient : float
        Depth by work (m J-1): Archard's coefficient over the area that wears.
    surface_velocities : sequence of float, optional
        Velocities of the surfaces of the contacts (m s-1); by default those of `RoundContact`, and 0 of others.

    Examples
    --------
    >>> il.Wear(("rub",), coefficient=2e-12)
    Wear(contacts=('rub',), coefficient=2e-12)
    """

    citation = article(
        "Archard, J. F.", "Contact and rubbing of flat surfaces", "J. Appl. Phys.", 24, 1953, "981",
        "10.1063/1.1721448",
    )  # fmt: skip

    contacts: tuple[str, ...] | None = parameter(None)
    coefficient: float = parameter(0.0, units="m J-1", minimum=0.0)
    surface_velocities: tuple[float, ...] | None = parameter(None, units="m s-1")

    every_step: ClassVar[bool] = True

    def resolved(self, model: Model) -> Record:
        known, impulsive = model.contacts.names, model.contacts.impulsive
        soft = tuple(name for name, hard in zip(known, impulsive, strict=True) if not hard)
        names = names_of(self, CONTACT, self.contacts, "contact_force", model) if self.contacts else soft
        places = places_of(known)
        for name in names:
            if impulsive[places[name]]:
                law = type(model.contacts.laws[places[name]]).__name__
                raise InvalidInput(f"Wear: {name!r} is a {law}: its impacts have an impulse, but no force.")
        if not names:
            raise InvalidInput("Wear: no contact of this network has a force.")
        contacts = [model.network.contacts[name] for name in names]
        own = tuple(item.surface_velocity if isinstance(item, RoundContact) else 0.0 for item in contacts)
        given = own if self.surface_velocities is None else self.surface_velocities
        if len(given) != len(names):
            raise InvalidInput(f"Wear: {len(names)} contacts have so many surface_velocities, not {len(given)}.")
        result = self.replace(contacts=names, surface_velocities=given)
        mobility = model.ends.squares(1.0 / model.mass)
        holding = [_holding(item, mobility[places[name]]) for name, item in zip(names, contacts, strict=True)]
        object.__setattr__(result, "holding", np.array(holding))
        return result

    def stride(self, model: Model, step: float) -> int:
        return 1

    def keeper(self, run: RecordedRun, realizations: np.ndarray, ratio: int) -> Keeper:
        return _Works(self, run.plan, realizations, ratio)

    def label(self, run: RecordedRun, results: list[dict[str, np.ndarray]], interval: float) -> Variables:
        mean, error = run.mean([item["work"] for item in results], [item["samples"] for item in results])
        known = places_of(run.names("contact_force"))
        rate, scatter = np.full((2, len(known)), np.nan)
        slots = [known[name] for name in self.contacts or ()]
        rate[slots], scatter[slots] = mean, error
        for name, held, work in zip(self.contacts or (), _sums(results, "held"), _sums(results, "work"), strict=True):
            if held > MOST_HELD * work:
                enough = 0.7 * run.step * MOST_HELD * work / held  # the part falls more slowly than the step
                warn(
                    "step_bias",
                    f"Wear: the work rate of {name!r} may be too large: within a step friction takes away "
                    f"{held / work:.0%} of the velocity at which it slides. Take step={enough:.2g}.",
                )
        depth, of_depth = self.coefficient * rate, self.coefficient * scatter
        return {
            **with_error("contact_work_rate", (CONTACT,), rate, scatter, "W", "work rate of the contact"),
            **with_error("wear_rate", (CONTACT,), depth, of_depth, "m s-1", "rate of the depth of wear"),
        }


class _Works(Keeper):
    """Sums of work rates over samples."""

    def __init__(self, record: Wear, plan: Plan, realizations: np.ndarray, ratio: int) -> None:
        super().__init__(ratio)
        self.snapshot, self.ends = plan.snapshot, plan.system.ends
        places = places_of(plan.snapshot.names("contact_force"))
        self.slots = [places[name] for name in record.contacts or ()]
        self.surface = np.array(record.surface_velocities)[:, None]
        self.rate, self.slow = record.holding.T * [[plan.clock.step], [1.0]]  # type: ignore[attr-defined]
        self.parts = plan.samples_per_realization
        self.work = np.zeros((len(realizations), self.parts, len(self.slots)))
        self.held = np.zeros_like(self.work)
        self.samples = np.zeros((len(realizations), self.parts))

    def add(self, snapshots: np.ndarray, batch: int) -> None:
        own, part = self.own(snapshots), min(batch, self.parts - 1)
        places = (self.snapshot.place(name) for name in ("displacement", "velocity", "contact_force"))
        x, v, forces = (np.moveaxis(own[:, rows], 1, 0) for rows in places)  # (row, sample, lane)
        ground = np.zeros((1, *x.shape[1:]))
        velocities = _rubbing(self.ends, np.concatenate([x, ground]), np.concatenate([v, ground]))
        for row, slot in enumerate(self.slots):
            speed, across = velocities[slot]
            along = np.abs(speed + self.surface[row]) if across else np.maximum(speed, 0.0)
            force = np.abs(forces[slot])
            self.work[:, part, row] += (force * along).sum(axis=0)
            if self.rate[row]:
                taken = self.rate[row] * force * (1.0 - np.tanh(along / self.slow[row]) ** 2)
                self.held[:, part, row] += (force * along * taken).sum(axis=0)
        self.samples[:, part] += len(own)

    def result(self) -> dict[str, np.ndarray]:
        return {"work": self.work, "held": self.held, "samples": self.samples}


def _sums(results: list[dict[str, np.ndarray]], name: str) -> np.ndarray:
    """Return sums over all realizations, (contact,)."""
    return np.asarray(sum(item[name].sum(axis=(0, 1)) for item in results))


def _holding(contact: Contact | RoundContact, mobility: float) -> tuple[float, float]:
    """Return the rate at which friction slows sliding down over the normal force (s-1 N-1), and its velocity."""
    if not isinstance(contact, RoundContact) or not contact.friction_coefficient:
        return 0.0, 1.0
    return contact.friction_coefficient * mobility / contact.friction_velocity, contact.friction_velocity


def _rubbing(ends: Links, x: np.ndarray, v: np.ndarray) -> list[tuple[np.ndarray, bool]]:
    """Return the velocity across the radius of each round contact, and the closing one of others, and which it is."""
    closing = ends.rates(x, v)
    result = [(item, False) for item in closing]
    if isinstance(ends, RoundLinks):
        *_, across = ends.radii(x, v)
        for link, speed in zip(ends.round.tolist(), across, strict=True):
            result[link] = speed, True
    return result
