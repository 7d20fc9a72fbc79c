"""Integrators: a module for each kind, with the functions that are compiled and the classes that describe them."""
