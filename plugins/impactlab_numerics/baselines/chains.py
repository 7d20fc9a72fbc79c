"""Simulation of a chain as a careful user of numba writes it: one realization, loops over the bodies.

Unit masses; contact k is between bodies k and k + 1. The arguments are those of
`impactlab_numerics.baselines.pairs`; it is the displacement of the last body that is counted.
"""

from __future__ import annotations

import math

import numpy as np

from impactlab.compiling.jit import allocating


@allocating
def baoab(  # type: ignore[no-untyped-def]
    generator, samples, stride, step, k, c, noise, hertz, clearance, x, v, bodies, contacts, low, inverse, counts,
):  # fmt: skip
    """BAOAB splitting; parameters as of `pairs.baoab`, with n bodies and n - 1 contacts."""
    count, half, last = x.shape[0], 0.5 * step, counts.shape[0] - 1.0
    decay = np.exp(-c * step)
    scale = noise * np.sqrt(1.0 - decay * decay)
    for _ in range(samples):
        for _ in range(stride):
            for body in range(count):
                before = v[body]
                after = decay[body] * before + scale[body] * generator.standard_normal()
                x[body] += half * (before + after)
                v[body] = after
            push = 0.0  # of the contact on the left
            for body in range(count):
                place, force = x[body], 0.0
                if body + 1 < count:
                    indentation = place - x[body + 1] - clearance
                    if indentation > 0.0:
                        force = hertz * indentation * math.sqrt(indentation)
                        contacts[0, body] += 1.0
                        contacts[1, body] += force
                        contacts[2, body] = max(contacts[2, body], force)
                kick = half * (push - force - k[body] * place)
                middle = v[body] + kick
                v[body] = middle + kick
                bodies[0, body] += place
                bodies[1, body] += place * place
                bodies[2, body] += middle * middle
                push = force
        counts[int(min(max((x[count - 1] - low) * inverse + 1.0, 0.0), last))] += 1


@allocating
def euler_maruyama(  # type: ignore[no-untyped-def]
    generator, samples, stride, step, k, c, noise, hertz, clearance, x, v, bodies, contacts, low, inverse, counts,
):  # fmt: skip
    """Euler-Maruyama method; parameters as of `pairs.baoab`, with n bodies and n - 1 contacts."""
    count, last = x.shape[0], counts.shape[0] - 1.0
    scale = noise * np.sqrt(2.0 * c * step)
    for _ in range(samples):
        for _ in range(stride):
            push = 0.0
            for body in range(count):
                place, speed, force = x[body], v[body], 0.0
                if body + 1 < count:
                    indentation = place - x[body + 1] - clearance
                    if indentation > 0.0:
                        force = hertz * indentation * math.sqrt(indentation)
                        contacts[0, body] += 1.0
                        contacts[1, body] += force
                        contacts[2, body] = max(contacts[2, body], force)
                bodies[0, body] += place
                bodies[1, body] += place * place
                bodies[2, body] += speed * speed
                total = push - force - k[body] * place - c[body] * speed
                x[body] = place + step * speed
                v[body] = speed + step * total + scale[body] * generator.standard_normal()
                push = force
        counts[int(min(max((x[count - 1] - low) * inverse + 1.0, 0.0), last))] += 1


@allocating
def runge_kutta(  # type: ignore[no-untyped-def]
    series, first, samples, stride, step, k, c, hertz, clearance, x, v, bodies, contacts, low, inverse, counts,
):  # fmt: skip
    """Classical Runge-Kutta method; parameters as of `pairs.runge_kutta`."""
    count, last, now = x.shape[0], counts.shape[0] - 1.0, first
    stage_x, stage_v, slope_x, slope_v = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    for _ in range(samples):
        for _ in range(stride):
            for body in range(count):
                place, speed = x[body], v[body]
                stage_x[body], stage_v[body], slope_x[body], slope_v[body] = place, speed, 0.0, 0.0
                bodies[0, body] += place
                bodies[1, body] += place * place
                bodies[2, body] += speed * speed
            for stage in range(4):
                weight = step / 6.0 if stage == 0 or stage == 3 else step / 3.0
                ahead = step if stage == 2 else 0.5 * step
                push, sample = 0.0, now + (stage + 1) // 2
                here = stage_x[0]
                for body in range(count):
                    speed, force, right = stage_v[body], 0.0, 0.0
                    if body + 1 < count:
                        right = stage_x[body + 1]
                        indentation = here - right - clearance
                        if indentation > 0.0:
                            force = hertz * indentation * math.sqrt(indentation)
                            if stage == 0:
                                contacts[0, body] += 1.0
                                contacts[1, body] += force
                                contacts[2, body] = max(contacts[2, body], force)
                    total = series[body, sample] + push - force - k[body] * here - c[body] * speed
                    slope_x[body] += weight * speed
                    slope_v[body] += weight * total
                    stage_x[body] = x[body] + ahead * speed
                    stage_v[body] = v[body] + ahead * total
                    push, here = force, right
            for body in range(count):
                x[body] += slope_x[body]
                v[body] += slope_v[body]
            now += 2
        counts[int(min(max((x[count - 1] - low) * inverse + 1.0, 0.0), last))] += 1
