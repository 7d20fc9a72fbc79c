"""Forces as a part of what calls them: only the loops over contacts change."""

import ast

from scenes import plan_of

import impactlab as il
from impactlab.compiling.inlined_forces import inlined_forces
from impactlab.machine import tuned


class ChosenInALoop(il.ContactLaw):
    """A law whose own loop ends with a choice of two, as a loop over contacts does."""

    stiffness: float = il.parameter(minimum=0.0)

    @staticmethod
    def force(indentation, stiffness):
        depth = indentation
        trial = 0.0
        for part in range(3):
            trial = depth - 0.25 * part * indentation
            depth = depth if trial <= 0.0 else trial
        return stiffness * depth


def functions(text):
    return {node.name: ast.unparse(node) for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)}


def texts(law):
    """Functions of a module for one lane as it is, and as a part of what calls it."""
    body = il.LinearOscillator.from_frequency(1.0, 0.05)
    network = il.Network({"a": body}, {"stop": il.Contact("a", il.WALL, law, clearance=0.1)}, {"a": il.WhiteNoise(1.0)})
    with tuned(single_lane_steps=0.0):
        text = plan_of(network, duration=1.0, realizations=1, step=0.01).forces.text
    return functions(text), functions(inlined_forces(text))


def test_laws_are_evaluated_where_contacts_are_closed():
    for law in (il.HertzContact(1e3), il.LinearContact(1e3), ChosenInALoop(1e3)):
        plain, inlined = texts(law)
        assert "seldom" not in "".join(plain.values())
        assert inlined["forces"].count("if seldom(not gap <= 0.0):\n") == 1
        (closed, opened) = inlined["forces"].split("if seldom(not gap <= 0.0):\n")[1].split("else:\n")[:2]
        assert "force = " in closed
        assert "_force(" in closed
        assert opened.split("\n")[0].strip() == "forces_of[member] = gap - gap"


def test_kernels_of_laws_stay_as_they_are():
    for law in (ChosenInALoop(1e3), il.HuntCrossleyContact(1e3, dissipation=0.5)):
        plain, inlined = texts(law)
        for name in plain.keys() - {"forces"}:
            assert inlined.get(name, plain[name]) == plain[name]
        assert any("force" in name for name in inlined.keys() - {"forces"})
    assert "seldom" not in inlined["forces"]  # what is solved for the velocity branches by itself
