"""The stationary law of two bodies from the Fokker–Planck equation, without random numbers."""

from impactlab.phase_space.solution import FokkerPlanckReference, fokker_planck

__all__ = ["FokkerPlanckReference", "fokker_planck"]
