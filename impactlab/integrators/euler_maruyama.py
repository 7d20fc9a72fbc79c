"""The Euler-Maruyama method, a baseline for white noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from impactlab.integrators.base import ExplicitIntegrator, compiled
from impactlab.kernels.jit import borrow
from impactlab.kernels.kick import accelerate, add_forced, add_held_noise, add_series, clear, combine
from impactlab.kernels.random import fill_steps
from impactlab.kernels.series import NEAR, bring_near
from impactlab.kernels.sums import SLOTS, close_slot, empty_slots, keep, write_snapshot


class EulerMaruyama(ExplicitIntegrator):
    """Euler-Maruyama method with a fixed step: first order, stable only below ``2 ζ/ω``.

    It is here as the baseline that most hand-written simulations use (Maruyama, Rend. Circ. Mat.
    Palermo 4, 1955, 48).
    """

    order: ClassVar[float] = 1.0
    stability_polynomial: ClassVar[tuple[float, ...]] = (1.0, 1.0)
    fraction: ClassVar[float] = 0.02

    @staticmethod
    def loop(single: bool = False) -> Callable[..., None]:
        return compiled(_advance, single)


def _advance(  # type: ignore[no-untyped-def]
    forces, parameters, indices, coefficients, cross, noise, series, forced, state, history, sums, snapshots,
    step, passes, summing, first, count, every, phase,
):  # fmt: skip
    noise, series, forced = borrow(noise), borrow(series), borrow(forced)
    state, history, sums = borrow(state), borrow(history), borrow(sums)
    coefficients, parameters, indices = borrow(coefficients), borrow(parameters), borrow(indices)
    x, v, total = state.x, state.v, state.total
    indentation, contact_force, external = state.indentation, state.contact_force, state.external
    empty_slots(history, 0, first % SLOTS)
    for index in range(count):
        now = first + index
        slot = now % SLOTS
        clear(external)
        if noise.bodies.shape[0]:
            if index == 0 or now % 4 == 0:
                fill_steps(noise, now // 4, state.normals)
            sample = index if noise.scale.shape[0] > 1 else 0
            add_held_noise(noise, sample, state.normals, now % 4, external)
        if series.bodies.shape[0]:
            if index == 0 or now % NEAR == 0:
                bring_near(series, now // NEAR * NEAR)
            add_series(series, now % NEAR, external)
        if forced.bodies.shape[0]:
            add_forced(forced.force, index, forced.bodies, external)
        forces(x, v, v, 0.0, parameters, indices, indentation, contact_force, total)
        if summing:
            keep(history, slot, x, v, indentation, contact_force)
            close_slot(history, slot, index == count - 1, sums)
        accelerate(coefficients, x, v, external, total)
        combine(x, step, v, x)
        combine(v, step, total, v)
        if every and (phase + index + 1) % every == 0:
            forces(x, v, v, 0.0, parameters, indices, indentation, contact_force, total)
            write_snapshot(x, v, contact_force, sums, snapshots, (phase + index + 1) // every - 1)
