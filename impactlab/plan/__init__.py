"""What a simulation will do, decided before it runs, as plain picklable data."""

from impactlab.plan.plan import Plan

__all__ = ["Plan"]
