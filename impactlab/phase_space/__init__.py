"""The stationary law of two bodies from the Fokker–Planck equation, without random numbers."""

from impactlab.phase_space.law import FokkerPlanckReference
from impactlab.phase_space.solution import fokker_planck

__all__ = ["FokkerPlanckReference", "fokker_planck"]
