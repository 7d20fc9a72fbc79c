"""Laws of one's own, as users write them, on which rules, warnings and error bars are tried."""
