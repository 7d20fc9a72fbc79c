"""Networks without friction and noise, in many copies side by side that start differently."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import impactlab as il

MASSES = (1.0, 2.0, 0.7, 1.5, 1.0, 0.5, 1.2, 0.8)
SPRINGS = (0.5, 1.0, 0.3, 0.8, 0.6, 0.2, 0.9, 0.4)


class Scene(NamedTuple):
    """A network whose energy is constant.

    Attributes
    ----------
    make : callable
        Makes one copy.
    rate : float
        Contacts that close per second in a copy, roughly.
    speed : float
        Standard deviation of the momenta at the start over the root of the masses (m s-1 kg^0.5).
    power : float
        p in the force ``δ^p`` by which contacts open and close; infinite if they never do.
    """

    make: Callable[[], il.Network]
    rate: float
    speed: float = 1.0
    power: float = np.inf


def pair(law: il.ContactLaw) -> il.Network:
    """Two bodies on springs that touch at rest."""
    bodies = {
        "a": il.LinearOscillator(mass=1.0, stiffness=1.0),
        "b": il.LinearOscillator(mass=2.0, stiffness=3.0),
    }
    return il.Network(bodies, {"gap": il.Contact("a", "b", law)})


def chain(law: il.ContactLaw, clearance: float) -> il.Network:
    """Eight unlike bodies on springs between two walls."""
    bodies = [il.LinearOscillator(mass=m, stiffness=k) for m, k in zip(MASSES, SPRINGS, strict=True)]
    return il.chain(8, bodies, law, clearance=clearance, walls=True)


def free_chain() -> il.Network:
    """Eight free bodies; a spring between the first and the last one keeps them together."""
    network = il.chain(8, [il.LinearOscillator(mass=m) for m in MASSES], il.HertzContact(30.0), clearance=0.1)
    return network.replace(couplings={"spring": il.Coupling("body_0", "body_7", il.LinearCoupling(1.0))})


SCENES = {
    "pair, Hertz": Scene(lambda: pair(il.HertzContact(1.5)), 0.22, power=1.5),
    "pair, linear": Scene(lambda: pair(il.LinearContact(2.0)), 0.24, power=1.0),
    "chain, Hertz": Scene(lambda: chain(il.HertzContact(30.0), 0.6), 2.2, power=1.5),
    "chain, linear": Scene(lambda: chain(il.LinearContact(40.0), 0.6), 2.6, power=1.0),
    "pressed chain, Hertz": Scene(lambda: chain(il.HertzContact(30.0), -1.5), 2.2, speed=0.8),
}
"""The scenes whose energy is followed; in the last one no contact ever opens."""


def starts(network: il.Network, copies: int, speed: float, seed: Any) -> dict[str, dict[str, float]]:
    """Return normal velocities at rest positions for copies of a network."""
    rng = np.random.default_rng(seed)
    return {
        "velocity": {
            f"{name}_{copy}": speed * float(rng.standard_normal()) / body.mass**0.5
            for copy in range(copies)
            for name, body in network.oscillators.items()
        }
    }


def side_by_side(network: il.Network, copies: int) -> il.Network:
    """Return a network of independent copies, one after the other."""

    def named(side: Any, copy: int) -> Any:
        return f"{side}_{copy}" if isinstance(side, str) else side

    def moved(links: Any) -> dict[str, Any]:
        return {
            f"{name}_{copy}": link.replace(first=named(link.first, copy), second=named(link.second, copy))
            for copy in range(copies)
            for name, link in links.items()
        }

    bodies = {f"{name}_{copy}": body for copy in range(copies) for name, body in network.oscillators.items()}
    return il.Network(bodies, moved(network.contacts), {}, moved(network.couplings))


def automatic_step(network: il.Network, initial: Any, duration: float) -> float:
    """Return the step that a simulation from a start chooses (s)."""
    from impactlab.assembly.model import Model
    from impactlab.plan.request import Request
    from impactlab.simulation.planning import make_plan

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", il.AccuracyWarning)  # of the energy, which is to be measured
        request = Request(
            duration=duration, realizations=1, step=None, integrator=il.ExactFlow(), spin_up=None, initial=initial,
            records=[], seed=(0, 0), workers=1,
        )  # fmt: skip
        plan = make_plan(Model.of(network), request)
    return plan.clock.step


class Path(NamedTuple):
    """A scene whose paths are compared with those of a solver of high order."""

    network: il.Network
    power: float


def _touching(law: il.ContactLaw) -> il.Network:
    bodies = {
        "a": il.LinearOscillator(stiffness=4.0, damping=1.0),
        "b": il.LinearOscillator(stiffness=9.0, damping=1.0, mass=2.0),
    }
    return il.Network(bodies, {"gap": il.Contact("a", "b", law, clearance=0.1)})


def paths() -> dict[str, Path]:
    """Return the scenes of the orders, by their least smooth force."""
    smooth = {
        "a": il.DuffingOscillator(cubic=30.0, stiffness=4.0, damping=1.0),
        "b": il.DuffingOscillator(cubic=5.0, stiffness=9.0, damping=1.0, mass=2.0),
    }
    return {
        "smooth": Path(il.Network(smooth), np.inf),
        "Hertz": Path(_touching(il.HertzContact(100.0)), 1.5),
        "linear": Path(_touching(il.LinearContact(100.0)), 1.0),
    }


def path_starts(copies: int) -> dict[str, dict[str, float]]:
    """Return starts whose collisions fall into steps differently."""
    return {
        "displacement": {
            name: value
            for k in range(copies)
            for name, value in ((f"a_{k}", -0.5 - 0.04 * k), (f"b_{k}", 0.3 + 0.03 * k))
        },
        "velocity": {f"a_{k}": 1.0 + 0.1 * k for k in range(copies)},
    }


BOUNCE_DURATION = 2.5
"""Time in which a pair of `bounces` touches once and parts (s)."""

BOUNCING = {"Hertz": 1.5, "linear": 1.0}
"""Contacts of `bounces`, and their power p."""


def bounces(kind: str, copies: int, seed: Any) -> tuple[il.Network, dict[str, dict[str, float]], float]:
    """Return free pairs that touch once, their start, and the frequency Ω of the contact at its deepest (rad s-1).

    Stiffness and distance differ from pair to pair, so that contacts open and close anywhere within steps. The bodies
    of 1 and 2 kg approach each other at 1 m/s.
    """
    rng = np.random.default_rng(seed)
    stiffness, gap = rng.uniform(50.0, 150.0, copies), rng.uniform(0.3, 0.6, copies)
    law = {"Hertz": il.HertzContact, "linear": il.LinearContact}[kind]
    network = il.Network(
        {f"{name}_{k}": il.LinearOscillator(mass=m) for k in range(copies) for name, m in (("a", 1.0), ("b", 2.0))},
        {f"gap_{k}": il.Contact(f"a_{k}", f"b_{k}", law(stiffness[k])) for k in range(copies)},
    )
    initial = {
        "displacement": {f"a_{k}": -float(gap[k]) for k in range(copies)},
        "velocity": {f"a_{k}": 1.0 for k in range(copies)},
    }
    p, mass = BOUNCING[kind], 2.0 / 3.0
    depth = (0.5 * mass * (p + 1.0) / 100.0) ** (1.0 / (p + 1.0))
    return network, initial, float(np.sqrt(p * 100.0 * depth ** (p - 1.0) / mass))
