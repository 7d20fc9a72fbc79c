"""Gauss–Legendre rules are exact for polynomials, and stand in one module."""

from pathlib import Path

import numpy as np
import pytest

import impactlab
from impactlab.quadrature import gauss_legendre, legendre_coefficients, mean_rule


@pytest.mark.parametrize("points", [1, 4, 8, 16])
def test_rules_are_exact_up_to_their_degree(points):
    power = 2 * points - 2
    (nodes, weights), (places, shares) = gauss_legendre(points), mean_rule(points)
    assert (nodes**power) @ weights == pytest.approx(2.0 / (power + 1), rel=1e-13)
    assert (places ** (power + 1)) @ shares == pytest.approx(1.0 / (power + 2), rel=1e-13)
    assert not nodes.flags.writeable


def test_coefficients_give_values_back():
    values = np.random.default_rng(1).normal(size=8)
    coefficients = values @ legendre_coefficients(8)
    np.testing.assert_allclose(np.polynomial.legendre.legval(gauss_legendre(8)[0], coefficients), values, rtol=1e-12)


def test_nodes_come_from_one_module():
    package = Path(impactlab.__file__).parent
    found = {file.name for file in package.rglob("*.py") if "leggauss" in file.read_text(encoding="utf-8")}
    assert found == {"quadrature.py"}
