"""Mechanisms: each one is at home here. `impactlab.assembly.mechanism` imports this package, by which all are known."""

from impactlab.mechanisms import excitations, forces_of_links, laws_and_bodies, prescribed_motion  # noqa: F401
from impactlab.mechanisms.dry_friction import sticking  # noqa: F401
from impactlab.mechanisms.filtered_noise import processes_of_filters  # noqa: F401
from impactlab.mechanisms.impulses import process_of_impulses  # noqa: F401
from impactlab.mechanisms.rigid_contacts import rigid  # noqa: F401
