"""Exact stationary laws, and the comparison of results with them.

If the noises are independent and white, every body that is forced or damped has the
same temperature ``T = π S / damping`` (S the two-sided density of the force), all
forces are conservative and ``exp(−H/T)`` can be normalised, then the stationary
density is proportional to ``exp(−H/T)``, H being the energy.
"""
