"""The public names, for editors and type checkers; `__init__.py` loads them when they are used."""

from impactlab.check import NetworkCheck as NetworkCheck
from impactlab.compiled import CompiledNetwork as CompiledNetwork
from impactlab.component import Component as Component
from impactlab.component import parameter as parameter
from impactlab.contact import WALL as WALL
from impactlab.contact import Contact as Contact
from impactlab.contact import ContactLaw as ContactLaw
from impactlab.contact import HertzContact as HertzContact
from impactlab.contact import LinearContact as LinearContact
from impactlab.contact import PowerLawContact as PowerLawContact
from impactlab.dataset import network_of as network_of
from impactlab.dataset import save as save
from impactlab.density import Density as Density
from impactlab.density import JointDensity as JointDensity
from impactlab.errors import AccuracyWarning as AccuracyWarning
from impactlab.errors import Diverged as Diverged
from impactlab.errors import ImpactLabError as ImpactLabError
from impactlab.errors import ImpactLabWarning as ImpactLabWarning
from impactlab.errors import InvalidInput as InvalidInput
from impactlab.errors import NoExactReference as NoExactReference
from impactlab.excitation import Excitation as Excitation
from impactlab.excitation import ShinozukaNoise as ShinozukaNoise
from impactlab.excitation import WhiteNoise as WhiteNoise
from impactlab.integrators import EulerMaruyama as EulerMaruyama
from impactlab.integrators import ExactFlow as ExactFlow
from impactlab.integrators import Integrator as Integrator
from impactlab.integrators import RungeKutta4 as RungeKutta4
from impactlab.network import Network as Network
from impactlab.network import chain as chain
from impactlab.oscillator import DuffingOscillator as DuffingOscillator
from impactlab.oscillator import LinearOscillator as LinearOscillator
from impactlab.oscillator import Oscillator as Oscillator
from impactlab.record import PerRealization as PerRealization
from impactlab.record import Record as Record
from impactlab.record import Trajectory as Trajectory
from impactlab.reference import ExactReference as ExactReference
from impactlab.reference import compare as compare
from impactlab.reference import exact as exact
from impactlab.simulation import rerun as rerun
from impactlab.simulation import simulate as simulate
from impactlab.study import Study as Study
from impactlab.study import run_study as run_study

__version__: str
