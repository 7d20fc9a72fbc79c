"""Classes of networks by how they are run: from given states, briefly, with few realizations."""

from __future__ import annotations

from typing import Any

import numpy as np

from impactlab_numerics.trust.drawing import BODY_STEPS, Scene, Sketch, between, number


def starts(rng: np.random.Generator) -> Scene:
    """Given states, cold starts without a spin-up, and short runs, some of them without any noise."""
    sketch = Sketch(rng, ratio=(0.02, 0.5))
    noisy, kind = rng.random() < 0.7, int(rng.integers(3))
    if rng.random() < 0.4:
        sketch.body(noise=noisy)
    elif noisy:
        sketch.tree(number(rng, most=3), clearance=(0.5, 3.0))
    else:
        sketch.tree(1, sketch.damped, clearance=(0.5, 3.0), noise=False)
    options: dict[str, Any] = {"duration": between(rng, 0.3, 5.0) * sketch.slowest, "spin_up": 0.0}
    if kind == 0 and noisy:
        options["initial"] = "rest"
    elif kind == 1 or not noisy:
        touching = {side for item in sketch.contacts.values() for side in (item.first, item.second)}
        free = [name for name in sketch.bodies if name not in touching]
        far = {name: sketch.spread(name) * float(rng.uniform(-6.0, 6.0)) for name in free}
        options["initial"] = {"displacement": far, "velocity": sketch.velocities(6.0)}
        del options["spin_up"]
    if not noisy:
        options["realizations"] = 1
    else:
        affordable = BODY_STEPS * 0.5 / sketch.fastest / len(sketch.bodies)
        options["realizations"] = int(np.clip(affordable / options["duration"], 64, 4096))
    return sketch.scene(options=options, transient=True, deterministic=not noisy)


def few_realizations(rng: np.random.Generator) -> Scene:
    """One to eight realizations: long enough for batches, and shorter."""
    sketch = Sketch(rng, ratio=(0.05, 0.5))
    sketch.tree(number(rng), clearance=(-1.0, 2.0))
    realizations = int(rng.integers(1, 9))
    batches = 64 / realizations + 2.0
    times = 20.0 * batches * (between(rng, 1.0, 4.0) if rng.random() < 0.8 else between(rng, 0.1, 1.0))
    return sketch.scene(options={"realizations": realizations, "duration": times * sketch.slowest})
