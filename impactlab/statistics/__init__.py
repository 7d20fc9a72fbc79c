"""From sums to values with standard errors."""
