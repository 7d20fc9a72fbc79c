"""Records: what a simulation keeps besides its statistics."""
