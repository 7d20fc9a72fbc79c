"""Rules for the step of a run."""
