"""Questions that take some seconds, for programs that are killed in their midst."""

import numpy as np
from scenes import base

import impactlab as il
from impactlab.analysis import basins


def answer(question, make, clearances, starts, **kept):
    """Return what a call finds; `make` is a function of the program, whose processes have to find it."""
    if question == "simulate":
        return il.simulate(base(), 1500.0, realizations=64, record=il.Density(bins=20), rng=1, **kept)
    if question == "one":
        return il.simulate(base(), 30000.0, rng=1, record=[il.Spectrum(), il.PeakForces()], **kept)
    if question == "sweep":
        values = {"clearance": np.linspace(0.02, 0.1, clearances)}
        return il.sweep(make, values, duration=400.0, realizations=8, rng=1, **kept)
    basins.AT_A_TIME = 1000
    network = il.Network(
        {"a": il.LinearOscillator(stiffness=1.0, damping=0.1)},
        {"s": il.Contact("a", il.WALL, il.RigidContact(0.8), clearance=1.0)},
        {"a": il.Harmonic(1.0, frequency=2.8)},
    )
    points = np.linspace(-1.0, 1.0, starts)
    return il.basins(network, ("displacement:a", "velocity:a"), {"x": points, "v": points}, **kept)
