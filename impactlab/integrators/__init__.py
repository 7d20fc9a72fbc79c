"""Integrators: one module each, with the compiled loop and the class that describes it."""

from impactlab.integrators.base import Integrator
from impactlab.integrators.euler_maruyama import EulerMaruyama
from impactlab.integrators.exact_flow import ExactFlow
from impactlab.integrators.runge_kutta import RungeKutta4

__all__ = ["EulerMaruyama", "ExactFlow", "Integrator", "RungeKutta4"]
