"""The bias of a step, measured on the network in short segments at the step and at a part of it."""
