"""The scaling study: cost against the number of bodies, the clearance and the noise."""
