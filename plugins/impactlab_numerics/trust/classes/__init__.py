"""Classes of random networks, each drawn by one function."""
