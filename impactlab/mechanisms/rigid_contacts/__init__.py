"""Rigid contacts: a mechanism, its part of a plan, and impacts within a step."""
