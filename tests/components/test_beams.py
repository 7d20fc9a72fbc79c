"""Modes of beams: published roots, orthogonality, static deflections, and a cantilever that moves."""

import math

import numpy as np
import pytest

import impactlab as il

LENGTH, STIFFNESS, MASS = 1.7, 43.0, 0.6
NODES, WEIGHTS = np.polynomial.legendre.leggauss(400)
PLACES = 0.5 * LENGTH * (1.0 + NODES)
ROOTS = {
    "cantilever": (1.87510406871196, 4.69409113297418, 7.85475743823761, 10.9955407348755, 14.1371683910465),
    "clamped-clamped": (4.73004074486270, 7.85320462409584, 10.9956078380017, 14.1371654912575, 17.2787596573995),
    "clamped-pinned": (3.92660231204792, 7.06858274562873, 10.2101761228130, 13.3517687777541, 16.4933614313464),
    "pinned-pinned": tuple(math.pi * number for number in range(1, 6)),
}
"""βL of the first modes: R. D. Blevins, Formulas for Natural Frequency and Mode Shape (1979), table 8-1."""
TIP = {"tip": LENGTH}


def beam(supports, modes=20, points=(("half", 0.5 * LENGTH),)):
    return il.beam(
        LENGTH, STIFFNESS, MASS, supports=supports, modes=modes, damping_ratios=0.01, points=dict(points)
    )  # fmt: skip


def shapes(supports, places, modes=20):
    """Displacements of the modes at some places, (place, mode)."""
    points = {f"p{number}": place for number, place in enumerate(places.tolist())}
    return np.array([*beam(supports, modes, points).points.values()])


@pytest.mark.parametrize("supports", ROOTS)
def test_frequencies_are_those_of_the_published_roots(supports):
    frequencies = np.array(beam(supports).natural_frequencies)
    roots = LENGTH * (frequencies / math.sqrt(STIFFNESS / MASS)) ** 0.5
    np.testing.assert_allclose(roots[:5], ROOTS[supports], rtol=3e-14)
    with np.errstate(over="ignore"):
        zero = {
            "cantilever": np.cos(roots) + 1.0 / np.cosh(roots),
            "clamped-clamped": np.cos(roots) - 1.0 / np.cosh(roots),
            "clamped-pinned": np.sin(roots) - np.tanh(roots) * np.cos(roots),
            "pinned-pinned": np.sin(roots),
        }[supports]
    np.testing.assert_allclose(zero, 0.0, atol=1e-13)


@pytest.mark.parametrize("supports", ROOTS)
def test_modes_are_orthogonal_with_unit_masses(supports):
    rows = shapes(supports, PLACES)
    masses = MASS * 0.5 * LENGTH * (rows.T * WEIGHTS) @ rows
    np.testing.assert_allclose(masses, np.eye(20), atol=2e-13)


@pytest.mark.parametrize("supports", ROOTS)
def test_high_modes_do_not_cancel(supports):
    """At both ends of the 100th mode, against the asymptotic shape, of which the exponentials reach nowhere else."""
    inner = np.linspace(0.2, 0.8, 7) * LENGTH
    root = LENGTH * (np.array(beam(supports, 100).natural_frequencies[-1]) / math.sqrt(STIFFNESS / MASS)) ** 0.5
    angle = root * inner / LENGTH
    wave = math.sqrt(2.0) * np.sin(angle) if supports == "pinned-pinned" else np.sin(angle) - np.cos(angle)
    np.testing.assert_allclose(
        shapes(supports, inner, 100)[:, -1] * math.sqrt(MASS * LENGTH), wave, atol=1e-11
    )  # fmt: skip


def test_a_tip_moves_as_twice_the_mean_square():
    np.testing.assert_allclose(
        np.abs(beam("cantilever", 30, TIP).points["tip"]), 2.0 / math.sqrt(MASS * LENGTH), rtol=1e-12
    )


@pytest.mark.parametrize("supports", ROOTS)
def test_participation_is_the_integral_of_the_shapes(supports):
    """The squares add up to the mass of the beam."""
    found = np.array(beam(supports).participation)
    np.testing.assert_allclose(found, MASS * 0.5 * LENGTH * WEIGHTS @ shapes(supports, PLACES), atol=1e-13)
    many = float((np.array(beam(supports, 100).participation) ** 2).sum())
    assert 0.99 < many / (MASS * LENGTH) < 1.0


def test_gravity_bends_a_cantilever_as_a_uniform_load():
    """By ``μ g L⁴/8EI`` at the tip; the forces on the modes are those of a network."""
    structure = beam("cantilever", 60, TIP)
    ground = il.BaseMotion(il.ConstantForce(9.81))
    pulled = il.Network({"beam": structure}, {}, {"ground": ground}).sources["ground"].on
    forces = 9.81 * np.array([pulled[f"beam.{number}"] for number in range(1, 61)])
    tip = (forces * structure.points["tip"] / np.array(structure.natural_frequencies) ** 2).sum()
    assert tip == pytest.approx(-MASS * 9.81 * LENGTH**4 / (8.0 * STIFFNESS), rel=1e-8)
    two, of_tip = {"tip": LENGTH, "half": 0.5 * LENGTH}, il.BaseMotion(il.ConstantForce(9.81), on="beam.tip")
    with pytest.raises(il.InvalidInput, match="follows the ground as a whole; name the structure itself"):
        il.Network({"beam": beam("cantilever", 3, two)}, {}, {"ground": of_tip})


STATIC = {
    "cantilever": (LENGTH, 1.0 / 3.0), "pinned-pinned": (0.5 * LENGTH, 1.0 / 48.0),
    "clamped-clamped": (0.5 * LENGTH, 1.0 / 192.0), "clamped-pinned": (0.5 * LENGTH, 7.0 / 768.0),
}  # place of a load, and its deflection over P L³/EI  # fmt: skip


@pytest.mark.parametrize("supports", STATIC)
def test_static_deflections_are_sums_over_modes(supports):
    """Of 60 modes; the rest, of at most ``4 Σ 1/(βL)⁴``, is added as an integral."""
    place, factor = STATIC[supports]
    structure = beam(supports, 60, {"load": place})
    frequencies, row = np.array(structure.natural_frequencies), np.array(structure.points["load"])
    flexibility = float((row**2 / frequencies**2).sum()) * STIFFNESS / LENGTH**3
    rest = 4.0 / (3.0 * math.pi**4 * 59.0**3)
    assert 0.0 < factor - flexibility < rest
    assert flexibility == pytest.approx(factor, rel=1e-5)


def test_a_cantilever_under_a_step_load_swings_about_its_static_deflection():
    """In a network, where the load is at the tip: the mean over a long time, of three modes that decay."""
    damped = il.beam(LENGTH, STIFFNESS, MASS, supports="cantilever", modes=3, damping_ratios=0.5, points=TIP)
    network = il.Network({"beam": damped}, {}, {"beam.tip": il.ConstantForce(0.2)})
    record = il.Trajectory(5.0)
    path = il.simulate(network, 5.0, step=0.01, initial="rest", record=record).displacement.isel(realization=0, time=-1)
    shapes, frequencies = np.array(damped.points["tip"]), np.array(damped.natural_frequencies)
    tip, modes = float(path.values @ shapes), float((shapes**2 / frequencies**2).sum())
    assert tip == pytest.approx(0.2 * modes, rel=1e-9)
    assert modes == pytest.approx(LENGTH**3 / (3.0 * STIFFNESS), rel=2e-3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"supports": "free-free"}, r"supports must be one of 'cantilever', .*, not 'free-free'. Modes of a free beam"),
        ({"modes": 0}, r"modes must be a whole number from 1 to 100, not 0"),
        ({"modes": 2.5}, r"modes must be a whole number, not 2.5"),
        ({"length": -1.0}, r"beam: length must be larger than 0 m"),
        ({"bending_stiffness": 0.0}, r"beam: bending_stiffness must be larger than 0 N m2"),
        ({"mass_per_length": math.nan}, r"beam: mass_per_length must be a finite number"),
        ({"points": {"far": 2.0}}, r"point 'far' must be on the beam, from 0 to 1.7 m, not at 2.0 m"),
        ({"points": {"held": 0.0}}, r"point 'held' at 0.0 m does not move in any of the 3 modes"),
        ({"points": {"held": "0"}}, r"points\['held'\] must be a number"),
        ({"points": [1.0]}, r"points must be a mapping of names to numbers"),
        ({"damping_ratios": -0.1}, r"damping_ratios must be at least 0"),
    ],
)
def test_what_is_no_beam_is_refused(changes, message):
    given = {"length": LENGTH, "bending_stiffness": STIFFNESS, "mass_per_length": MASS, "supports": "cantilever",
             "modes": 3, "damping_ratios": 0.01, "points": TIP}  # fmt: skip
    with pytest.raises(il.InvalidInput, match=message):
        il.beam(**(given | changes))


def test_a_node_does_not_move():
    assert beam("pinned-pinned", 4).points["half"][1::2] == (0.0, 0.0)
