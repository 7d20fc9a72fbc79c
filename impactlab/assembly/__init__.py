"""From a composition to arrays of numbers, to the text of a module, to compiled functions."""
