"""What a run needs to know of a network for the accounts of its energy, as plain data."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from impactlab.assembly.model import Model
from impactlab.components.evaluation import TIME, call_each
from impactlab.records.contacts_in_plane import ContactsInPlane
from impactlab.records.law_kernels import LawKernels, added
from impactlab.records.power_accounts import Accounts, summed

MOMENTS = 4097
"""Times at which the density of a noise that varies is looked at for its mean."""


class OfNetwork(NamedTuple):
    """What a run needs to know of a network, as plain data."""

    accounts: Accounts
    laws: LawKernels
    linear: np.ndarray  # (3, body) mass, damping and stiffness
    couplings: np.ndarray  # (2, coupling) stiffness and damping of linear ones
    clearance: np.ndarray  # (contact,)
    white: np.ndarray  # (drive,) expectation of the power of a white noise; NaN of other sources
    forced: np.ndarray  # (force,) which drives are given forces
    free: np.ndarray  # (body,) of bool, whether forces move it
    conservative: np.ndarray  # (link,) of bool, whether it has a potential and loses nothing
    lossless: np.ndarray  # (body,) of bool, the same of its residual force
    in_plane: ContactsInPlane | None  # of contacts, where some are round

    @classmethod
    def of(cls, model: Model, begin: float, end: float) -> OfNetwork:
        """Return what is known of a network for a run between two times (s)."""
        accounts = Accounts.of(model)
        white, forced, first = np.full(len(accounts.driven), np.nan), [], 0
        for name, kind in model.sources.items():
            drives = kind.drives
            rows = slice(first, first + len(drives.body))
            if name == "intensity":
                density = model.noise.density
                if model.noise.varying:
                    times = np.broadcast_to(np.linspace(begin, end, MOMENTS), (len(density), MOMENTS))
                    values = call_each(kind.excitations, "intensity", times)
                    density = np.trapezoid(values, times, axis=1) / (end - begin)
                white[rows] = np.pi * density[drives.source] * drives.weight**2 / model.mass[drives.body]
            elif name == "force":
                forced = list(range(rows.start, rows.stop))
            first = rows.stop
        linear, free = np.stack([model.mass, model.damping, model.stiffness]), model.bodies.free
        couplings = model.couplings.linear
        places = np.array(forced, dtype=np.int64)
        keeps = [
            law.has_kernel("potential") and {"rate", TIME}.isdisjoint(law.kernel("force")[1])
            for law in (*model.contacts.laws, *model.couplings.laws)
        ]
        lossless = [
            body.has_kernel("residual_potential") and {"velocity", TIME}.isdisjoint(body.kernel("residual")[1])
            for body in model.bodies.oscillators
        ]
        loses = np.append(np.zeros(len(model.ends)), couplings[1]) > 0.0
        springs = np.append(np.zeros(len(model.ends)), couplings[0]) > 0.0
        in_plane = ContactsInPlane.of(model)
        if in_plane is not None:
            loses[: len(model.ends)] = in_plane.friction[0] > 0.0
        conservative = (np.array(keeps, dtype=bool) | springs) & ~loses
        return cls(
            accounts, LawKernels.of(model), linear, couplings, model.clearance, white, places, free, conservative,
            np.array(lossless, dtype=bool), in_plane,
        )  # fmt: skip

    def energies(self, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the energies of bodies, then of links, (body and link, lane), at displacements and velocities."""
        entries, contacts = self.accounts.entries, len(self.accounts.contacts)
        mass, _, stiffness = (item[:, None] for item in self.linear)
        along = summed(entries.weights[:, None] * x[entries.slots], entries.rows, self.accounts.links)
        gaps = along[:contacts] if self.in_plane is None else self.in_plane.elongations(x[None], v[None], False)[0]
        places = {"indentation": np.maximum(gaps - self.clearance[:, None], 0.0)}
        places["extension"] = -along[contacts:]
        kinds = {"indentation": self.laws.contact_energies, "extension": self.laws.coupling_energies}
        none = np.zeros((1, 0, x.shape[1]))  # laws with potentials have no states
        of_laws = {name: added(laws, {name: places[name][None]}, none)[0] for name, laws in kinds.items()}
        bodies = 0.5 * (mass * v**2 + stiffness * x**2) + self.residual_energies(x)
        couplings = 0.5 * self.couplings[0][:, None] * places["extension"] ** 2 + of_laws["extension"]
        in_contacts = of_laws["indentation"]
        in_contacts[np.isinf(in_contacts)] = 0.0  # rigid contacts store nothing, and rounding may close them
        return np.concatenate([bodies, in_contacts, couplings])

    def residual_energies(self, x: np.ndarray) -> np.ndarray:
        """Return what residual forces store, (body, lane)."""
        found = added(self.laws.residual_energies, {"displacement": x[None]}, np.zeros((1, 0, x.shape[1])))
        return np.asarray(found[0])

    def lost_in_residuals(self, taken: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """Return what residual forces lose, (body, unit), from what they take and keep."""
        return np.where(self.lossless[:, None], 0.0, taken - kept)
