"""The work-precision study: run time against error of many methods."""
