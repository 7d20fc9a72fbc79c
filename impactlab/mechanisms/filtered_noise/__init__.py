"""Filtered noise: the motion under it, its samples, and its part of a plan."""
