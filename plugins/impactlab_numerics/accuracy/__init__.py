"""The accuracy study: bias on random networks, coverage of intervals, tolerances."""
