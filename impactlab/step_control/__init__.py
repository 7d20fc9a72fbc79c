"""Whether the step of a run is right: rules before the run, the bias that is measured, and a tolerance."""
