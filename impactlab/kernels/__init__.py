"""Static compiled kernels over blocks ``[body, lane]``; a lane is one realization.

The functions here know nothing of names, components or networks: numbers in, numbers
out, SI units throughout. Every loop over lanes is innermost and vectorises.
"""
