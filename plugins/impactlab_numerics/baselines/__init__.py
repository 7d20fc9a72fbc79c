"""Plain loops of numba and NumPy, written as a user would, with which speeds are compared."""
