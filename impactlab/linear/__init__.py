"""Linear motion under white noise, cosines and given forces."""
