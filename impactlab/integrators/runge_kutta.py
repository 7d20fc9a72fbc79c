"""The classical Runge-Kutta method of fourth order, for smooth excitation."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from impactlab.integrators.base import ExplicitIntegrator, compiled
from impactlab.kernels.jit import borrow
from impactlab.kernels.kick import accelerate, add_forced, add_held_noise, add_series, clear, combine, copy
from impactlab.kernels.random import fill_steps
from impactlab.kernels.series import NEAR, bring_near
from impactlab.kernels.sums import SLOTS, close_slot, empty_slots, keep, write_snapshot


class RungeKutta4(ExplicitIntegrator):
    """Classical Runge-Kutta method with a fixed step.

    It is of fourth order for smooth forces; where Hertz contacts open and close, the second
    derivative of the force is singular and about 2.5 remains. Series of cosines and given
    forces are sampled at half steps. White noise is held constant over a step: the
    usual approximation, of second order in the mean squares of a linear body.
    """

    order: ClassVar[float] = 4.0
    samples_per_step: ClassVar[int] = 2
    stability_polynomial: ClassVar[tuple[float, ...]] = (1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0)
    fraction: ClassVar[float] = 0.05

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
    stage_x, stage_v = state.reading, state.velocity
    indentation, contact_force = state.indentation, state.contact_force
    external, slope_x, slope_v = state.external, state.slope_x, state.slope_v
    empty_slots(history, 0, first % SLOTS)
    for index in range(count):
        now = first + index
        slot = now % SLOTS
        if noise.bodies.shape[0] and (index == 0 or now % 4 == 0):
            fill_steps(noise, now // 4, state.normals)
        if series.bodies.shape[0] and (index == 0 or 2 * now % NEAR == 0):
            bring_near(series, 2 * now // NEAR * NEAR)
        copy(x, stage_x)
        copy(v, stage_v)
        clear(slope_x)
        clear(slope_v)
        for stage in range(4):
            offset = (stage + 1) // 2  # half steps: 0, 1, 1, 2
            if stage != 2:  # the middle is sampled once
                clear(external)
                if noise.bodies.shape[0]:
                    sample = index if noise.scale.shape[0] > 1 else 0
                    add_held_noise(noise, sample, state.normals, now % 4, external)
                if series.bodies.shape[0]:
                    add_series(series, 2 * now % NEAR + offset, external)
                if forced.bodies.shape[0]:
                    add_forced(forced.force, 2 * index + offset, forced.bodies, external)
            forces(stage_x, stage_v, stage_v, 0.0, parameters, indices, indentation, contact_force, total)
            if stage == 0 and summing:
                keep(history, slot, x, v, indentation, contact_force)
                close_slot(history, slot, index == count - 1, sums)
            accelerate(coefficients, stage_x, stage_v, external, total)
            weight = 1.0 / 6.0 if stage == 0 or stage == 3 else 1.0 / 3.0
            ahead = step if stage == 2 else 0.5 * step
            combine(slope_x, weight, stage_v, slope_x)
            combine(slope_v, weight, total, slope_v)
            combine(x, ahead, stage_v, stage_x)
            combine(v, ahead, total, stage_v)
        combine(x, step, slope_x, x)
        combine(v, step, slope_v, v)
        if every and (phase + index + 1) % every == 0:
            forces(x, v, v, 0.0, parameters, indices, indentation, contact_force, total)
            write_snapshot(x, v, contact_force, sums, snapshots, (phase + index + 1) // every - 1)
