"""Bugs in energy flows and quantities of one's own, of networks whose powers are known."""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

import impactlab as il
from impactlab.records import energy_flows, observable
from impactlab.records.accounted_network import OfNetwork
from impactlab.records.power_accounts import Accounts
from planted.detectors import Distances, Scene
from planted.plant import Bug, returned


def _power(voltage, resistance):  # type: ignore[no-untyped-def]
    return voltage * voltage / resistance


def _network() -> Any:
    """Two bodies at two temperatures, coupled, and a harvester with its circuit."""
    body = il.LinearOscillator(damping=0.1, stiffness=1.0)
    heat = 0.1 / math.pi
    return il.Network(
        {"hot": body, "cold": body, "beam": il.LinearOscillator(damping=0.04, stiffness=1.0)},
        couplings={
            "spring": il.Coupling("hot", "cold", il.LinearCoupling(0.5)),
            "patch": il.Coupling(il.WALL, "beam", il.PiezoelectricCoupling(0.4, capacitance=1.0, resistance=1.0)),
        },
        excitations={"hot": il.WhiteNoise(2.0 * heat), "cold": il.WhiteNoise(heat), "beam": il.WhiteNoise(1.0)},
    )


class Warm(Scene):
    """Their flux of heat and the mean power of the harvester are known; and a damper between bodies that collide."""

    name = "energy flows"

    @cache  # noqa: B019  # scenes are few
    def law(self) -> Any:
        return {"flux": 0.1 * 0.25 / (2.0 * (0.25 + 0.01 * 1.5)), "power": 2.026833970}

    def evidence(self) -> Any:
        records = [il.EnergyFlows(), il.Observable("power", _power, per="coupling", units="W")]
        return il.simulate(_network(), 3000.0, realizations=128, rng=3, record=records, step=0.1)

    def distances(self, found: Any, law: Any) -> Distances:
        def score(name: str, expected: float, **place: Any) -> float:
            value, error = (float(found[item].sel(**place)) for item in (name, f"{name}_standard_error"))
            return abs(value - expected) / error

        result = {
            "flux": score("coupling_power_carried", law["flux"], coupling="spring"),
            "loss": score("coupling_power_dissipated", law["power"], coupling="patch"),
            "mean": score("mean_power", law["power"], power_coupling="patch"),
            "balance": float(np.abs(found.power_balance / found.power_balance_standard_error).max()),
        }
        return result | {
            "network": abs(float(found.network_power_balance / found.network_power_balance_standard_error))
        }


WARM = Warm()

BUGS = [
    Bug("power of noise by Stratonovich's half", WARM,
        returned(OfNetwork, "of", lambda right, *_: right._replace(white=0.5 * right.white))),
    Bug("links that give to both sides", WARM,
        returned(energy_flows.LinksInSnapshots, "pulls", lambda right, *_: -right)),
    Bug("carried the other way", WARM, returned(Accounts, "carried", lambda right, *_: -right)),
    Bug("mean of one sample too many", WARM,
        returned(observable._Values, "result",
                 lambda right, *_: {**right, "samples": 1.02 * right["samples"]})),
]  # fmt: skip

SCENES = [WARM]
