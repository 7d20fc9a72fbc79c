"""A cantilever that rattles at a stop below its tip: by its modes in closed form, by elements, and by differences."""

import numpy as np
import pytest
from scipy.optimize import brentq

import impactlab as il

MODES = 10
DRAG, VISCOSITY = 0.3, 3e-4  # damping over mass, and over stiffness


def closed_form(modes=MODES):
    """Modes of a clamped beam of unit length, mass and bending stiffness, with its middle and its tip."""
    middles = (np.arange(modes) + 0.5) * np.pi
    roots = np.array([brentq(lambda b: np.cos(b) + 1.0 / np.cosh(b), middle - 1.0, middle + 1.0) for middle in middles])
    sigma, half = (np.cosh(roots) + np.cos(roots)) / (np.sinh(roots) + np.sin(roots)), 0.5 * roots
    middle = np.cosh(half) - np.cos(half) - sigma * (np.sinh(half) - np.sin(half))
    points = {"middle": middle, "tip": 2.0 * (-1.0) ** np.arange(modes)}
    return il.ModalStructure(roots**2, 0.5 * (DRAG / roots**2 + VISCOSITY * roots**2), points=points)


def elements(count):
    """The same in cubic elements: consistent masses, deflections and slopes at the nodes, no modes."""
    h = 1.0 / count
    bend = np.array([[12.0, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2],
                     [-12, -6 * h, 12, -6 * h], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) / h**3  # fmt: skip
    inert = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2],
                      [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]) * h / 420.0  # fmt: skip
    mass, stiffness = np.zeros((2, 2 * count + 2, 2 * count + 2))
    for element in range(count):
        place = slice(2 * element, 2 * element + 4)
        mass[place, place] += inert
        stiffness[place, place] += bend
    names = [f"{kind} {node + 1}" for node in range(count) for kind in ("deflection", "slope")]
    names[-2], names[count - 2] = "tip", "middle"
    mass, stiffness = mass[2:, 2:], stiffness[2:, 2:]
    return il.LinearStructure(mass, DRAG * mass + VISCOSITY * stiffness, stiffness, names=names)


def differences(count):
    """The same as a chain of masses, whose curvatures are central differences; clamped at the node before the first."""
    h = 1.0 / count
    mass, share = np.full(count, h), np.full(count, h)
    mass[-1] = share[0] = 0.5 * h
    curvature = np.eye(count, count, -1) - 2.0 * np.eye(count, count, 0) + np.eye(count, count, 1)
    curvature = np.vstack([2.0 * np.eye(1, count), curvature[:-1]]) / h**2  # the clamped end is a line of symmetry
    stiffness = (curvature.T * share) @ curvature
    names = [f"node {number + 1}" for number in range(count)]
    names[-1], names[count // 2 - 1] = "tip", "middle"
    return il.LinearStructure(mass, DRAG * np.diag(mass) + VISCOSITY * stiffness, stiffness, names=names)


def rattling(beam):
    """White noise at the tip, which can touch a stop."""
    stop = il.Contact("beam.tip", il.WALL, il.HertzContact(1e3), clearance=0.05)
    return il.Network({"beam": beam}, {"stop": stop}, {"beam.tip": il.WhiteNoise(1e-4)})


def test_the_law_without_a_stop():
    """Elements converge to the closed form with the fourth power of their length."""
    networks = (rattling(beam).replace(contacts={"stop": None}) for beam in (elements(4), elements(8), closed_form()))
    coarse, fine, exact = (
        il.exact(network).statistics().point_variance_displacement.sel(point=["beam.middle", "beam.tip"])
        for network in networks
    )
    errors = [np.abs(law / exact - 1.0).max().item() for law in (coarse, fine)]
    assert errors[1] < 1e-4
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.3)


def test_the_law_of_differences_without_a_stop():
    """Differences converge with the second power of their length."""
    exact = il.exact(rattling(closed_form()).replace(contacts={"stop": None})).statistics()
    tip = exact.point_variance_displacement.sel(point="beam.tip").item()
    errors = []
    for count in (10, 20):
        law = il.exact(rattling(differences(count)).replace(contacts={"stop": None})).statistics()
        errors.append(1.0 - law.variance_displacement.sel(oscillator="beam.tip").item() / tip)
    assert 0.0 < errors[1] < 2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


STATISTICS = ["contact_ratio", "contact_rate", "mean_contact_force"]
AT_POINTS = ["point_mean_displacement", "point_variance_displacement"]


@pytest.mark.campaign
def test_modes_against_a_chain_of_differences():
    """Twenty masses have a variance without contact that is 0.17 % smaller, less than the errors here."""
    modal, discrete = (
        il.simulate(rattling(beam), duration=50.0, spin_up=40.0, realizations=64, step=5e-4, rng=seed)
        for seed, beam in enumerate((closed_form(), differences(20)))
    )
    assert modal.contact_ratio.item() > 0.02
    tip = modal.sel(point="beam.tip"), discrete.sel(oscillator="beam.tip")
    for name in [*STATISTICS, "variance_displacement"]:
        prefix = "" if name in STATISTICS else "point_"
        (one, error), (other, beside) = (
            (item[f"{start}{name}"].item(), item[f"{start}{name}_standard_error"].item())
            for item, start in zip(tip, (prefix, ""), strict=True)
        )
        assert error < 0.06 * one, name
        assert abs(one - other) < 3.5 * np.hypot(error, beside), name


@pytest.mark.campaign
@pytest.mark.parametrize(("count", "duration", "realizations"), [(4, 50.0, 64), (6, 200.0, 128)])
def test_modes_against_elements(count, duration, realizations):
    modal, discrete = (
        il.simulate(rattling(beam), duration=duration, spin_up=40.0, realizations=realizations, rng=seed)
        for seed, beam in enumerate((closed_form(), elements(count)))
    )
    assert modal.contact_ratio.item() > 0.02
    off = {}
    for name in [*STATISTICS, *AT_POINTS]:
        place = {"point": ["beam.middle", "beam.tip"]} if name in AT_POINTS else {}
        (one, error), (other, beside) = (
            (item[name].sel(place), item[f"{name}_standard_error"].sel(place)) for item in (modal, discrete)
        )
        off[name] = float((np.abs(one - other) / np.hypot(error, beside)).max())
        assert (error < 0.06 * np.abs(one)).all(), name
    assert max(off.values()) < 3.5, off
