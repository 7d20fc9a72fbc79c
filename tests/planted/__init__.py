"""Deliberately wrong variants of the code, and the scenes whose statistics must show them."""
