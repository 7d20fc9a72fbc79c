"""Questions of the field about the motions of a network: sections, orbits, exponents, basins."""
