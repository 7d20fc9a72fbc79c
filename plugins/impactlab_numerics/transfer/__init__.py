"""Exact laws of trees by transfer integrals, a second solver that shares nothing with `impactlab.exact`."""
