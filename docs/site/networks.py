import impactlab as il

network = il.Network(
    {"a": il.LinearOscillator(damping=0.5, stiffness=10.0)},
    {"stop": il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.1)},
    {"a": il.WhiteNoise(1.0)},
)
driven = il.Network(
    {"a": il.LinearOscillator(damping=0.1, stiffness=1.0)},
    {"stop": il.Contact("a", il.WALL, il.RigidContact(0.8))},
    {"a": il.Harmonic(1.0, frequency=2.0)},
)
