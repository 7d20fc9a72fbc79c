"""impactlab: networks of oscillators that collide, simulated and checked.

The public names are loaded when they are first used, so that importing the package
is cheap. ``__init__.pyi`` lists them for editors and type checkers.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "component": ["Component", "parameter"],
    "oscillator": ["DuffingOscillator", "LinearOscillator", "Oscillator"],
    "contact": ["WALL", "Contact", "ContactLaw", "HertzContact", "LinearContact", "PowerLawContact"],
    "excitation": ["Excitation", "ShinozukaNoise", "WhiteNoise"],
    "coupling": ["Coupling", "CouplingLaw", "LinearCoupling"],
    "network": ["Network", "chain"],
    "check": ["NetworkCheck"],
    "compiled": ["CompiledNetwork"],
    "integrators": ["EulerMaruyama", "ExactFlow", "Integrator", "RungeKutta4"],
    "density": ["Density", "JointDensity"],
    "derived": ["effective_samples", "jackknife"],
    "peaks": ["PeakForces"],
    "record": ["PerRealization", "Record", "Trajectory"],
    "spectrum": ["Spectrum"],
    "simulation": ["simulate"],
    "sweeps": ["sweep"],
    "again": ["network_of", "rerun"],
    "reference": ["ExactReference", "compare", "exact"],
    "phase_space": ["FokkerPlanckReference", "fokker_planck"],
    "dataset": ["save"],
    "studies": ["Study"],
    "studies.running": ["run_study"],
    "errors": [
        "AccuracyWarning",
        "Diverged",
        "ImpactLabError",
        "ImpactLabWarning",
        "InvalidInput",
        "NoExactReference",
    ],
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}

__all__ = sorted([*_MODULE, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module 'impactlab' has no attribute {name!r}")
    value = getattr(import_module(f"impactlab.{_MODULE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
