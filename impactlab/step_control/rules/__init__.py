"""The step by rules, before a run: forces at expected energies, relaxation times, and the step that they allow."""
