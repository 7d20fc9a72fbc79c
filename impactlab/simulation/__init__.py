"""Simulations: blocks of realizations, the cores they run on, and the page that calls everything."""
