"""How code is made, rewritten, compiled, kept in files and loaded; no numerics.

Only here is numba imported.
"""
