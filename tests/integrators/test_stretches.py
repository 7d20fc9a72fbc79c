"""Steps of few bodies in registers are those of the loop of all networks, bit for bit."""

import numpy as np
import pytest
from scenes import plan_of

import impactlab as il
from impactlab.integrators import stretches
from impactlab.integrators.stretches import stretching, worth_compiling
from impactlab.machine import tuned
from impactlab.plan.in_registers import layout_of
from impactlab.simulation.block import Block

EXACT = il.ExactFlow(jumps=False, measured=False)


def body(frequency=1.0, **options):
    return il.LinearOscillator.from_frequency(frequency, 0.05, **options)


def stop(law, excitation):
    return il.Network({"a": body(6.0)}, {"stop": il.Contact("a", il.WALL, law, clearance=0.05)}, {"a": excitation})


def chain(law, **options):
    excitations = {"a": il.WhiteNoise(1.0), "all": il.Source(il.Harmonic(3.0, frequency=2.0), on={"a": 1.0, "c": -0.5})}
    contacts = {"ab": il.Contact("a", "b", law, clearance=0.1), "bc": il.Contact("b", "c", law, clearance=0.05)}
    return il.Network({"a": body(1.0), "b": body(2.0), "c": body(3.0)}, contacts, excitations, **options)


NETWORKS = {
    "noise": stop(il.HertzContact(1e4), il.WhiteNoise(1.0)),
    "strong friction": il.Network(
        {"a": il.LinearOscillator(mass=1.0, damping=20.0, stiffness=40.0)},
        {"stop": il.Contact("a", il.WALL, il.HertzContact(1e4), clearance=0.01)}, {"a": il.WhiteNoise(1.0)},
    ),
    "harmonic": stop(il.LinearContact(1e4), il.Harmonic(10.0, frequency=5.0)),
    "pulse": stop(il.HertzContact(1e4), il.Pulse(30.0, duration=0.5, start=1.0)),
    "damped": stop(il.HuntCrossleyContact(1e4, dissipation=0.5), il.WhiteNoise(1.0)),
    "chain": chain(il.HertzContact(1e3)),
    "couplings": chain(
        il.HuntCrossleyContact(1e3, dissipation=0.2), couplings={"ac": il.Coupling("a", "c", il.LinearCoupling(0.01))}
    ),
    "residual": il.Network(
        {"a": il.DuffingOscillator(damping=0.3, stiffness=1.0, cubic=5.0), "b": body(2.0)},
        {"gap": il.Contact("a", "b", il.HertzContact(1e3), clearance=0.05)}, {"a": il.WhiteNoise(0.5)},
    ),
}  # fmt: skip


def measured(network, in_registers, **options):
    """Sums and snapshots of one realization, and the state at its end."""
    with tuned(single_lane_steps=0.0):
        plan = plan_of(network, **({"duration": 4.0, "spin_up": 0.0, "step": 0.004, "integrator": EXACT} | options))
    block = Block(plan, plan.realizations.of(0), lambda steps: None)
    block.stretch = stretching(layout_of(plan))[1] if in_registers else 0
    result = block.measure()
    kept = [array for record in result.records for array in record.values()]
    state = block.state.x, block.state.v, block.state.reading, block.state.velocity, block.state.total
    return [result.bodies, result.contacts, result.products, result.points, *kept, *(item.copy() for item in state)]


QUICK = {"damped", "chain"}
"""Networks with noise and forces of bodies and contacts; each takes seconds to compile."""

WHICH = [name if name in QUICK else pytest.param(name, marks=pytest.mark.campaign) for name in NETWORKS]


@pytest.mark.full
@pytest.mark.parametrize("name", WHICH)
def test_steps_in_registers_have_the_bits_of_the_loop(name):
    records = [il.Trajectory(0.012)]
    own, others = (measured(NETWORKS[name], item, realizations=1, records=records) for item in (True, False))
    assert len(own) == len(others)
    for one, other in zip(own, others, strict=True):
        np.testing.assert_array_equal(one, other)
    assert others[1].any()  # bodies touched


def test_what_keeps_a_network_out_of_registers():
    def layout(network, **options):
        with tuned(single_lane_steps=0.0):
            return layout_of(plan_of(network, **({"duration": 4.0, "realizations": 1, "integrator": EXACT} | options)))

    assert layout(NETWORKS["noise"])
    assert layout(NETWORKS["noise"], realizations=2) is None
    assert layout(NETWORKS["noise"], integrator=il.RungeKutta4(), step=1e-3) is None
    assert layout(stop(il.HertzContact(1e4), il.OrnsteinUhlenbeckNoise(1.0, correlation_time=1.0))) is None
    assert layout(stop(il.RigidContact(restitution=0.7), il.WhiteNoise(1.0))) is None
    assert layout(il.chain(5, body(), il.HertzContact(1e3), clearance=0.1, excitation=il.WhiteNoise(1.0))) is None


def test_the_compiler_is_waited_for_where_enough_steps_were_made():
    with tuned(single_lane_steps=0.0):
        layout = layout_of(plan_of(NETWORKS["noise"], duration=4.0, realizations=1, integrator=EXACT))
    new = layout._replace(passes=99)  # of a network that nobody has compiled
    assert not worth_compiling(new, stretches.WORTH_COMPILING - 1)
    assert worth_compiling(new, 1)
