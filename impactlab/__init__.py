"""impactlab: networks of oscillators that collide, simulated and checked.

The public names are loaded when they are first used, so that importing the package
is cheap. ``__init__.pyi`` lists them for editors and type checkers.
"""

import gc
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_HOME = {
    "components.catalogue": ["catalogue"],
    "components.component": ["Component"],
    "components.fields": ["parameter", "state"],
    "components.beams": ["beam"],
    "components.structure": ["Structure"],
    "components.modal_structure": ["ModalStructure"],
    "components.linear_structure": ["LinearStructure"],
    "components.oscillator": [
        "DoubleWellOscillator",
        "DuffingOscillator",
        "InvertedOscillator",
        "LinearOscillator",
        "Oscillator",
        "ParametricOscillator",
    ],
    "components.self_excited": ["RayleighOscillator", "VanDerPolOscillator"],
    "components.prescribed": ["PrescribedMotion"],
    "components.uncertain_number": ["Uncertain"],
    "components.sides": ["WALL", "Combination"],
    "components.contact": [
        "Contact",
        "ContactLaw",
        "HertzContact",
        "LinearContact",
        "PowerLawContact",
        "RigidContact",
        "RoundContact",
        "backlash",
    ],
    "components.excitation": ["BaseMotion", "Excitation", "Source", "WhiteNoise"],
    "components.cosines": ["ShinozukaNoise", "TabulatedNoise"],
    "components.coloured": [
        "BandPassNoise",
        "CloughPenzien",
        "FilteredNoise",
        "KanaiTajimi",
        "OrnsteinUhlenbeckNoise",
    ],
    "components.coherent": ["SharedCosines", "coherent", "davenport", "harichandran_vanmarcke"],
    "components.correlated": ["correlated"],
    "components.impulses": ["PoissonImpulses"],
    "components.loads": ["Chirp", "ConstantForce", "Harmonic", "Pulse", "SampledForce"],
    "components.modulated": ["Modulated", "ModulatedForce", "ModulatedImpulses", "ModulatedNoise"],
    "components.dissipative": [
        "CarvalhoMartinsContact",
        "FloresContact",
        "GonthierContact",
        "HertzdampContact",
        "HuntCrossleyContact",
        "JankowskiContact",
        "KelvinVoigtContact",
        "LankaraniNikraveshContact",
        "TsujiContact",
    ],
    "components.plastic": ["AdhesiveContact", "ThorntonContact", "WaltonBraunContact"],
    "components.coupling": ["CoulombFrictionCoupling", "Coupling", "CouplingLaw", "LinearCoupling"],
    "components.dampers": [
        "FrictionCoupling",
        "PowerLawDampingCoupling",
        "QuadraticDampingCoupling",
    ],
    "components.hysteresis": [
        "BoucWenCoupling",
        "JenkinsCoupling",
        "MaxwellCoupling",
        "PiezoelectricCoupling",
        "ZenerCoupling",
    ],
    "components.springs": ["BilinearCoupling", "CubicCoupling", "PowerLawCoupling"],
    "networks.network": ["Network", "chain"],
    "networks.check": ["NetworkCheck"],
    "networks.compiled": ["CompiledNetwork"],
    "integrators.base": ["Integrator"],
    "integrators.exact_flow": ["ExactFlow"],
    "integrators.explicit": ["EulerMaruyama", "ExplicitIntegrator", "RungeKutta4"],
    "located.event_located": ["EventLocated"],
    "records.density": ["Density", "JointDensity"],
    "statistics.jackknife": ["effective_samples", "jackknife"],
    "records.extremes": ["Extremes"],
    "records.cycles": ["Cycles"],
    "records.correlation": ["Correlation"],
    "records.wear": ["Wear"],
    "records.final_state": ["FinalState"],
    "records.first_passage": ["FirstPassage"],
    "records.impact": ["Impacts"],
    "records.peak_forces": ["PeakForces"],
    "records.phase": ["PhaseDensity", "PhaseMeans"],
    "records.record": ["Keeper", "Record"],
    "records.recorded_run": ["RecordedRun"],
    "records.section": ["Section"],
    "records.energy_flows": ["EnergyFlows"],
    "records.observable": ["Observable"],
    "records.spectrum": ["Spectrum"],
    "records.trajectory": ["PerRealization", "Trajectory"],
    "records.surface": ["AtContact", "Crossing", "Strobe"],
    "analysis.basins": ["basins"],
    "analysis.bifurcation": ["bifurcation"],
    "analysis.continuation": ["continue_orbits"],
    "analysis.fragility": ["fragility", "required_separation"],
    "analysis.lyapunov": ["lyapunov"],
    "analysis.orbits": ["orbits"],
    "analysis.spread": ["orbit_spread"],
    "analysis.uncertain": ["uncertain"],
    "simulation.event": ["Event"],
    "simulation.held_run": ["Run"],
    "simulation.worker_processes": ["Processes"],
    "simulation.simulate": ["simulate"],
    "sweeps.sweep": ["sweep"],
    "plotting.animation": ["animate"],
    "sweeps.accelerations": ["absolute_acceleration"],
    "sweeps.citation": ["citation"],
    "sweeps.rerun": ["network_of", "rerun"],
    "reference.compare": ["compare"],
    "reference.over_time": ["exact_covariance"],
    "reference.reference": ["ExactReference", "exact"],
    "reference.fokker_planck.absorbing": ["PassageReference"],
    "reference.fokker_planck.law": ["FokkerPlanckReference"],
    "reference.fokker_planck.solution": ["fokker_planck"],
    "results.dataset": ["load", "save"],
    "results.time_series": ["read_time_series"],
    "studies": ["Study"],
    "studies.running": ["run_study"],
    "errors": [
        "AccuracyWarning",
        "Diverged",
        "ImpactLabError",
        "ImpactLabWarning",
        "InvalidInput",
        "NoExactReference",
        "NoOrbit",
    ],
}
_MODULE = {name: module for module, names in _HOME.items() for name in names}
_SUBMODULES = ["plot"]

__all__ = sorted([*_MODULE, *_SUBMODULES, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _MODULE and name not in _SUBMODULES:
        raise AttributeError(f"module 'impactlab' has no attribute {name!r}")
    with _without_search():
        if name in _SUBMODULES:
            return import_module(f"impactlab.{name}")
        value = getattr(import_module(f"impactlab.{_MODULE[name]}"), name)
    globals()[name] = value
    return value


@contextmanager
def _without_search() -> Iterator[None]:
    """Let Python not look for garbage among the many objects of modules that are loaded meanwhile, which all stay."""
    collecting = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if not gc.get_freeze_count():  # else somebody has frozen objects, and they stay so
            gc.freeze()
            gc.unfreeze()  # to the oldest objects, which are searched seldom
        if collecting:
            gc.enable()


def __dir__() -> list[str]:
    return __all__
