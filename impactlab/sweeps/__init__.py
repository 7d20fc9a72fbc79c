"""Many simulations: over values, side by side, done again."""
