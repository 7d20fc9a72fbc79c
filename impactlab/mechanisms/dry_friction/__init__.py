"""Dry friction that sticks: a mechanism, its part of a plan, and slip and stick within a step."""
