"""Pictures: the style of figures, and drawings of networks."""
