"""The stability study: the steps at which each method is accurate, degraded or unstable."""
