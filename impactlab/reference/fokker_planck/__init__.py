"""The stationary law of two bodies from the Fokker–Planck equation, without random numbers."""
