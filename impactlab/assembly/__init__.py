"""From a composition to arrays of numbers, and to the text of a module."""
