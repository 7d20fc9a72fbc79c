"""What is known of nonlinear forces before a run: stiffness, energies, relaxation, closings of contacts."""
