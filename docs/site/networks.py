import numpy as np

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
hot = il.LinearOscillator(damping=0.5, stiffness=1.0)
pair = il.Network(
    {"hot": hot, "cold": hot},
    {"gap": il.Contact("hot", "cold", il.HertzContact(3.0), clearance=0.5)},
    {"hot": il.WhiteNoise(0.25), "cold": il.WhiteNoise(0.15)},
)


def towers(ground):
    body = il.LinearOscillator.from_frequency
    return il.Network(
        {"left": body(6.0, damping_ratio=0.05), "right": body(11.0, damping_ratio=0.05)},
        {"gap": il.Contact("left", "right", il.HertzContact(2e4), clearance=0.01)},
        {"ground": il.BaseMotion(ground)},
    )


draw, times = np.random.default_rng(1), 0.02 * np.arange(200)
records = [il.SampledForce(times, draw.normal(size=200), after="zero") for _ in range(8)]
