"""The conservation study: energy, time reversal, momentum and orders of convergence."""
