"""Three bodies on couplings, and their matrices written by hand."""

import numpy as np
from scipy.linalg import block_diag, solve_continuous_lyapunov

import impactlab as il

MASS, OWN = np.array([1.0, 2.0, 0.7]), np.array([0.8, 0.5, 1.1])

STIFFNESS = np.array([[60.0, -30.0, -10.0], [-30.0, 85.0, -50.0], [-10.0, -50.0, 75.0]])
"""Stiffness matrix of the trio, by hand."""

DAMPER = np.array([[3.0, -1.0, -2.0], [-1.0, 1.0, 0.0], [-2.0, 0.0, 2.0]])
"""Damping matrix of its couplings for damping 1."""


def spring(first="a", second="b", stiffness=30.0, damping=0.0):
    return il.Coupling(first, second, il.LinearCoupling(stiffness, damping=damping))


def trio(damping=0.0, hot=(1.0, 1.0, 1.0), **changes):
    """Three unlike bodies in a triangle of couplings, and one coupling to the wall; temperatures in J."""
    own_springs = 20.0, 5.0, 0.0
    parts = zip("abc", MASS, OWN, own_springs, strict=True)
    bodies = {name: il.LinearOscillator(mass=m, damping=c, stiffness=k) for name, m, c, k in parts}
    noises = {name: il.WhiteNoise(heat * c / np.pi) for name, heat, c in zip("abc", hot, OWN, strict=True) if heat}
    couplings = {
        "ab": spring("a", "b", 30.0, damping),
        "bc": spring("b", "c", 50.0),
        "ca": spring("c", "a", 10.0, 2.0 * damping),
        "wall": spring("c", il.WALL, 15.0),
    }
    return il.Network(bodies, {}, noises, couplings).replace(**changes)


def drift_by_hand(damping):
    """Matrix of (x, v)' of the trio, written by hand."""
    inverse = 1.0 / MASS[:, None]
    friction = np.diag(OWN) + damping * DAMPER
    return np.block([[np.zeros((3, 3)), np.eye(3)], [-inverse * STIFFNESS, -inverse * friction]])


def law_by_hand(hot, damping):
    """Covariance of (x, v) of the trio by its Lyapunov equation."""
    growth = block_diag(np.zeros((3, 3)), np.diag(2.0 * np.array(hot) * OWN / MASS**2))
    return solve_continuous_lyapunov(drift_by_hand(damping), -growth)
