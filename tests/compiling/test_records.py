"""Types of records follow from the annotations of their fields, and what runs hand over has these types."""

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba import f8, i8, types

import impactlab as il
from impactlab.compiling.own_memory import without_lane
from impactlab.compiling.records import Block, Numbers, Slots, type_of
from impactlab.integrators.arguments import loop_type
from impactlab.integrators.interval_arguments import JumpTables, Work
from impactlab.machine import tuned
from impactlab.plan.method import Method


class Inner(NamedTuple):
    block: Block
    slots: Slots


class Outer(NamedTuple):
    inner: Inner
    number: float
    count: int


class Swapped(NamedTuple):
    number: float
    inner: Inner
    count: int


def test_types_follow_annotations():
    block, row, slots = (types.Array(kind, rank, "C") for kind, rank in ((f8, 2), (f8, 1), (i8, 1)))
    assert type_of(Inner, False) == types.NamedTuple([block, slots], Inner)
    assert type_of(Inner, True) == types.NamedTuple([row, slots], Inner)
    assert [*type_of(Outer, False)] == [type_of(Inner, False), f8, i8]
    assert [*type_of(Swapped, False)] == [f8, type_of(Inner, False), i8]
    assert [*type_of(Outer, True, number=Numbers)] == [type_of(Inner, True), row, i8]


def test_a_field_without_a_type_is_refused():
    class Wrong(NamedTuple):
        path: str

    with pytest.raises(TypeError, match="annotated <class 'str'>, for which"):
        type_of(Wrong, False)


BODY = il.LinearOscillator(mass=1.0, damping=0.4, stiffness=40.0)


def near(law=None, **others):
    contacts = {"gap": il.Contact("one", "two", law or il.HertzContact(1e4), clearance=0.05)}
    return il.Network({"one": BODY, "two": BODY}, contacts, {"two": il.WhiteNoise(1.0)}, **others)


SCENES = {
    "smooth": (near(), {}),
    "rigid": (near(il.RigidContact(0.7)), {}),
    "states": (near(couplings={"k": il.Coupling("one", "two", il.MaxwellCoupling(2.0, damping=1.0))}), {}),
    "friction": (near(couplings={"k": il.Coupling("one", il.WALL, il.CoulombFrictionCoupling(0.5))}), {}),
    "rate": (near(il.HuntCrossleyContact(400.0, dissipation=1.0)), {}),
    "sources": (
        near().replace(
            excitations={
                "one": il.OrnsteinUhlenbeckNoise(5.0, correlation_time=0.1),
                "two": il.ShinozukaNoise(1.0, band=(0.0, 10.0), components=50, allow_repeat=True),
                "both": il.Source(il.WhiteNoise(0.1), on={"one": 1.0, "two": 0.5}),
                "shots": il.Source(il.PoissonImpulses(5.0, mean=0.5, standard_deviation=0.1), on="one"),
                "given": il.Source(il.Harmonic(1.0, frequency=1.7), on="two"),
            }
        ),
        {},
    ),
    "intervals": (
        near().replace(
            contacts={"gap": il.Contact("one", "two", il.HertzContact(1e4), clearance=3.0)},
            excitations={"one": il.WhiteNoise(1.0)},
        ),
        {"initial": "stationary", "duration": 10.0},
    ),
    "explicit": (near(), {"integrator": il.RungeKutta4()}),
}


class Checked(Exception):
    """Ends a run whose arguments were compared."""


def mismatches(item: Any, kind: Any, place: str):
    """Yield where a value has not the type of compiled code."""
    if isinstance(kind, types.BaseNamedTuple):
        if type(item) is not kind.instance_class:
            yield f"{place} is {type(item).__name__}, not {kind.instance_class.__name__}"
            return
        for name, value, inner in zip(kind.fields, item, kind, strict=True):
            yield from mismatches(value, inner, f"{place}.{name}")
    elif isinstance(kind, types.Array):
        found = (item.dtype.name, item.ndim, item.flags.c_contiguous)
        if found != (kind.dtype.name, kind.ndim, True):
            yield f"{place} is {found}, not {kind}"
    else:
        python = {"float64": float, "int64": int, "bool": bool}[kind.name]
        if not isinstance(item, python | np.generic) or np.dtype(type(item)) != np.dtype(python):
            yield f"{place} is {type(item).__name__}, not {kind}"


COSTLY = "rigid", "friction", "states", "sources"
"""Scenes whose mechanisms take seconds to compile for each kind of block."""


@pytest.mark.parametrize("realizations", [1, 8])
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.full] if name in COSTLY else []) for name in SCENES]
)
def test_runs_hand_over_what_is_annotated(name, realizations, monkeypatch):
    network, options = SCENES[name]
    options = {"duration": 1.0, "step": 0.005, "spin_up": 0.0, "initial": "rest", "rng": 1, "progress": False} | options
    seen = []

    def loop(self, single, series, points):
        assert (self.jumps is not None) == (name == "intervals")
        others = (JumpTables, Work) if self.jumps else ()
        kinds = loop_type(single, *others).args[1:]

        def compare(forces, accept, stretch, *arguments):
            values = map(without_lane, arguments, kinds) if single else arguments
            seen.append([*(found for pair in zip(values, kinds, strict=True) for found in mismatches(*pair, ""))])
            raise Checked

        return compare

    for method in (Method, *Method.__subclasses__()):
        monkeypatch.setattr(method, "loop", loop)
    with tuned(single_lane_steps=0.0), pytest.raises(Checked):
        il.simulate(network, realizations=realizations, **options)
    assert seen == [[]]
