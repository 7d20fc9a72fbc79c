"""Dense algebra for hundreds of bodies, against SciPy's, and how it answers signals."""

import signal
import time

import numpy as np
import pytest
from scipy import linalg

import impactlab as il
from impactlab.linear import large_matrices
from impactlab.linear.large_matrices import LARGE


def _stable(rows):
    """A drift with rates of decay, and a growth, (rows, rows) each."""
    generator = np.random.default_rng(5)
    drift = generator.standard_normal((rows, rows)) - 1.3 * np.sqrt(rows) * np.eye(rows)
    root = generator.standard_normal((rows, 3))
    return drift, root @ root.T


def test_a_large_lyapunov_equation_has_scipys_solution():
    drift, growth = _stable(LARGE + 45)
    found = large_matrices.lyapunov_solution(drift, growth)
    np.testing.assert_allclose(found, linalg.solve_continuous_lyapunov(drift, -growth), rtol=1e-10, atol=1e-15)


def test_a_large_schur_form_is_one():
    drift, _ = _stable(LARGE + 1)
    triangle, turned = large_matrices.schur(drift)
    np.testing.assert_allclose(turned @ triangle @ turned.T, drift, atol=1e-11)
    np.testing.assert_allclose(turned.T @ turned, np.eye(len(drift)), atol=1e-12)
    assert not np.tril(triangle, -2).any()


def test_errors_of_the_other_thread_come_through():
    with pytest.raises(np.linalg.LinAlgError, match="square"):
        large_matrices.answered(np.linalg.eigvals, np.ones((3, 2)))


@pytest.mark.full
@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs a timer that sends signals")
def test_signals_are_answered_while_a_large_system_is_planned():
    """The Schur form of 1200 rows takes a second; the others of LAPACK as long."""

    class Alarm(Exception):
        pass

    def ring(number, frame):
        raise Alarm(time.monotonic())

    drift, growth = _stable(1200)
    before = signal.signal(signal.SIGALRM, ring)
    try:
        due = time.monotonic() + 0.1
        signal.setitimer(signal.ITIMER_REAL, 0.1)
        with pytest.raises(Alarm) as told:
            large_matrices.lyapunov_solution(drift, growth)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert told.value.args[0] - due < 0.5


def _star(number, law):
    """A body that carries many others on springs."""
    bodies = {f"body_{i}": il.LinearOscillator(damping=1.0, stiffness=10.0) for i in range(number)}
    links = {f"link_{i}": il.Coupling("hub", f"body_{i}", law) for i in range(number)}
    hub = il.LinearOscillator(mass=10.0, damping=1.0, stiffness=10.0)
    return il.Network({"hub": hub, **bodies}, {}, {"hub": il.WhiteNoise(1.0)}, links)


@pytest.mark.parametrize("stiffness", [1.0, 1e6])
def test_planning_that_would_take_too_long_is_refused_beforehand(stiffness):
    network = _star(300, il.LinearCoupling(stiffness))
    with pytest.raises(il.InvalidInput, match="of 301 bodies that couplings connect would take about"):
        il.simulate(network, 1.0, rng=1, max_seconds=0.15)


def test_a_system_beyond_the_memory_is_refused(monkeypatch):
    monkeypatch.setattr("impactlab.linear.systems.available", lambda: 1e6)
    with pytest.raises(il.InvalidInput, match=r"301 bodies that couplings connect would take 0\.0232 GB of memory"):
        il.simulate(_star(300, il.LinearCoupling(1.0)), 1.0, rng=1)
