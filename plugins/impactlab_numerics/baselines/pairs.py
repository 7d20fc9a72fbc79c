"""Simulation of two bodies as a careful user of numba writes it: one realization, all in scalars.

Unit masses; arrays are per body, the contact is where ``x1 - x2`` exceeds the clearance.
Every loop adds up displacements, their squares and those of the velocities, time in contact,
force and largest force, and counts the displacement of the second body every `stride` steps.
"""

from __future__ import annotations

import math

from impactlab.compiling.jit import allocating


@allocating
def baoab(  # type: ignore[no-untyped-def]
    generator, samples, stride, step, k, c, noise, hertz, clearance, x, v, bodies, contacts, low, inverse, counts,
):  # fmt: skip
    """BAOAB splitting (Leimkuhler and Matthews, Appl. Math. Res. Express 2013, 34).

    Parameters
    ----------
    generator : numpy.random.Generator
    samples, stride : int
        Number of samples of the density, and of steps to each.
    step : float
    k, c : (2,) ndarray
        Stiffness and damping.
    noise : (2,) ndarray
        Standard deviation of the velocity at the temperature of the noise.
    hertz, clearance : float
        Contact.
    x, v : (2,) ndarray
        State, which is carried on.
    bodies, contacts : (3, 2), (3, 1) ndarray
        Sums of x, x², v² and of contact, force, and the largest force.
    low, inverse : float
        Lower limit and inverse width of the bins.
    counts : (bins + 2,) ndarray of int
        Samples below, in each bin and above.
    """
    x1, x2, v1, v2 = x[0], x[1], v[0], v[1]
    k1, k2, half = 0.5 * step * k[0], 0.5 * step * k[1], 0.5 * step
    e1, e2 = math.exp(-c[0] * step), math.exp(-c[1] * step)
    s1, s2 = noise[0] * math.sqrt(1.0 - e1 * e1), noise[1] * math.sqrt(1.0 - e2 * e2)
    sx1, sx2, sxx1, sxx2, svv1, svv2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    closed, total, peak, last = 0, 0.0, contacts[2, 0], counts.shape[0] - 1.0
    for _ in range(samples):
        for _ in range(stride):
            w1 = e1 * v1 + s1 * generator.standard_normal()
            w2 = e2 * v2 + s2 * generator.standard_normal()
            x1 += half * (v1 + w1)
            x2 += half * (v2 + w2)
            a1, a2, indentation = -k1 * x1, -k2 * x2, x1 - x2 - clearance
            if indentation > 0.0:
                force = hertz * indentation * math.sqrt(indentation)
                a1 -= half * force
                a2 += half * force
                closed += 1
                total += force
                peak = max(peak, force)
            w1 += a1
            w2 += a2
            sx1 += x1
            sx2 += x2
            sxx1 += x1 * x1
            sxx2 += x2 * x2
            svv1 += w1 * w1
            svv2 += w2 * w2
            v1 = w1 + a1  # the next step begins with the same force
            v2 = w2 + a2
        counts[int(min(max((x2 - low) * inverse + 1.0, 0.0), last))] += 1
    x[0], x[1], v[0], v[1] = x1, x2, v1, v2
    _store(bodies, contacts, sx1, sx2, sxx1, sxx2, svv1, svv2, closed, total, peak)


@allocating
def euler_maruyama(  # type: ignore[no-untyped-def]
    generator, samples, stride, step, k, c, noise, hertz, clearance, x, v, bodies, contacts, low, inverse, counts,
):  # fmt: skip
    """Euler-Maruyama method; parameters as of `baoab`."""
    x1, x2, v1, v2 = x[0], x[1], v[0], v[1]
    k1, k2, c1, c2 = k[0], k[1], c[0], c[1]
    s1, s2 = noise[0] * math.sqrt(2.0 * c1 * step), noise[1] * math.sqrt(2.0 * c2 * step)
    sx1, sx2, sxx1, sxx2, svv1, svv2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    closed, total, peak, last = 0, 0.0, contacts[2, 0], counts.shape[0] - 1.0
    for _ in range(samples):
        for _ in range(stride):
            force, indentation = 0.0, x1 - x2 - clearance
            if indentation > 0.0:
                force = hertz * indentation * math.sqrt(indentation)
                closed += 1
                total += force
                peak = max(peak, force)
            sx1 += x1
            sx2 += x2
            sxx1 += x1 * x1
            sxx2 += x2 * x2
            svv1 += v1 * v1
            svv2 += v2 * v2
            a1 = -k1 * x1 - c1 * v1 - force
            a2 = force - k2 * x2 - c2 * v2
            x1 += step * v1
            x2 += step * v2
            v1 += step * a1 + s1 * generator.standard_normal()
            v2 += step * a2 + s2 * generator.standard_normal()
        counts[int(min(max((x2 - low) * inverse + 1.0, 0.0), last))] += 1
    x[0], x[1], v[0], v[1] = x1, x2, v1, v2
    _store(bodies, contacts, sx1, sx2, sxx1, sxx2, svv1, svv2, closed, total, peak)


@allocating
def runge_kutta(  # type: ignore[no-untyped-def]
    series, first, samples, stride, step, k, c, hertz, clearance, x, v, bodies, contacts, low, inverse, counts,
):  # fmt: skip
    """Classical Runge-Kutta method under a sampled force.

    Parameters as of `baoab`, but for the force at half steps, ``series[body, time]``, and the
    index of its first sample.
    """
    x1, x2, v1, v2 = x[0], x[1], v[0], v[1]
    k1, k2, c1, c2, half, sixth = k[0], k[1], c[0], c[1], 0.5 * step, step / 6.0
    sx1, sx2, sxx1, sxx2, svv1, svv2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    closed, total, peak, last = 0, 0.0, contacts[2, 0], counts.shape[0] - 1.0
    now = first
    for _ in range(samples):
        for _ in range(stride):
            force, indentation = 0.0, x1 - x2 - clearance
            if indentation > 0.0:
                force = hertz * indentation * math.sqrt(indentation)
                closed += 1
                total += force
                peak = max(peak, force)
            sx1 += x1
            sx2 += x2
            sxx1 += x1 * x1
            sxx2 += x2 * x2
            svv1 += v1 * v1
            svv2 += v2 * v2
            a1 = series[0, now] - k1 * x1 - c1 * v1 - force
            a2 = series[1, now] - k2 * x2 - c2 * v2 + force
            p1, p2, q1, q2 = x1 + half * v1, x2 + half * v2, v1 + half * a1, v2 + half * a2
            force = _hertz(p1 - p2 - clearance, hertz)
            b1 = series[0, now + 1] - k1 * p1 - c1 * q1 - force
            b2 = series[1, now + 1] - k2 * p2 - c2 * q2 + force
            p1, p2, r1, r2 = x1 + half * q1, x2 + half * q2, v1 + half * b1, v2 + half * b2
            force = _hertz(p1 - p2 - clearance, hertz)
            g1 = series[0, now + 1] - k1 * p1 - c1 * r1 - force
            g2 = series[1, now + 1] - k2 * p2 - c2 * r2 + force
            p1, p2, w1, w2 = x1 + step * r1, x2 + step * r2, v1 + step * g1, v2 + step * g2
            force = _hertz(p1 - p2 - clearance, hertz)
            l1 = series[0, now + 2] - k1 * p1 - c1 * w1 - force
            l2 = series[1, now + 2] - k2 * p2 - c2 * w2 + force
            x1 += sixth * (v1 + 2.0 * (q1 + r1) + w1)
            x2 += sixth * (v2 + 2.0 * (q2 + r2) + w2)
            v1 += sixth * (a1 + 2.0 * (b1 + g1) + l1)
            v2 += sixth * (a2 + 2.0 * (b2 + g2) + l2)
            now += 2
        counts[int(min(max((x2 - low) * inverse + 1.0, 0.0), last))] += 1
    x[0], x[1], v[0], v[1] = x1, x2, v1, v2
    _store(bodies, contacts, sx1, sx2, sxx1, sxx2, svv1, svv2, closed, total, peak)


@allocating
def _hertz(indentation, stiffness):  # type: ignore[no-untyped-def]
    if indentation > 0.0:
        return stiffness * indentation * math.sqrt(indentation)
    return 0.0


@allocating
def _store(bodies, contacts, sx1, sx2, sxx1, sxx2, svv1, svv2, closed, total, peak):  # type: ignore[no-untyped-def]
    bodies[0, 0] += sx1
    bodies[0, 1] += sx2
    bodies[1, 0] += sxx1
    bodies[1, 1] += sxx2
    bodies[2, 0] += svv1
    bodies[2, 1] += svv2
    contacts[0, 0] += closed
    contacts[1, 0] += total
    contacts[2, 0] = peak
