"""What type checkers and editors know of components: the names and types of fields, of a user's classes too."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import impactlab as il

USER = '''
import numpy as np

import impactlab as il


class Cone(il.ContactLaw):
    """A law of one's own: its first field by position, a default by position."""

    stiffness: float = il.parameter(units="N m-2", minimum=0.0)
    offset: float = il.parameter(0.0, units="m")

    @staticmethod
    def force(indentation, stiffness, offset):  # type: ignore[no-untyped-def]
        return stiffness * (indentation + offset) ** 2


class StiffCone(Cone):
    hardening: float = il.parameter(1.0)


cone = Cone(1e4, offset=0.1)
stiff = StiffCone(1e4, offset=0.1, hardening=2.0).replace(offset=0.2)
body = il.DuffingOscillator(2.0, mass=1.5, stiffness=4.0)
light = il.LinearOscillator.from_frequency(6.0, 0.1).replace(mass=0.1)
contact = il.Contact("a", il.WALL, cone, clearance=0.05)
tower = il.ModalStructure([6.0, 31.0], 0.02, points={"top": [1.4, -1.4]}, mass=2.0)
noise = il.ShinozukaNoise(1.0, band=(0.0, 10.0), components=400)
network = il.Network({"a": body}, {"stop": contact}, {"a": noise})
ground = il.BaseMotion(il.SampledForce(np.arange(3.0), np.zeros(3), scale=2.0), on=["a"])
shaken = il.Network({"a": body}, {}, {"ground": ground})
records = [il.Density(bins=50), il.Trajectory(0.1), il.JointDensity("a", "b"), il.PerRealization()]
method = il.ExactFlow(jumps=False)
reveal_type(cone.offset)  # note: float
reveal_type(stiff)  # note: StiffCone
reveal_type(noise.components)  # note: int
Cone(1e4, ofset=0.1)  # error: Unexpected keyword argument "ofset"
Cone("hard")  # error: incompatible type "str"
il.LinearOscillator(1.0)  # error: Too many positional arguments
il.DuffingOscillator(1.0, mass="light")  # error: incompatible type "str"
il.HertzContact(1e4, exponent=1.5)  # error: Unexpected keyword argument "exponent"
body.mass = 2.0  # error: read-only
il.WhiteNoise(1.0).density  # error: has no attribute "density"
'''


@pytest.mark.campaign
def test_a_type_checker_knows_the_fields_and_refuses_no_correct_program(tmp_path):
    """mypy says what the comments of a user's file expect, and nothing else."""
    lines = USER.splitlines()
    (tmp_path / "user.py").write_text(USER, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "--config-file", os.devnull, "--strict", "--cache-dir", ".cache", "user.py"],
        cwd=tmp_path, env={**os.environ, "MYPYPATH": str(Path(il.__file__).parents[1])}, text=True, capture_output=True,
        check=False,
    )  # fmt: skip
    said = [re.match(r"user\.py:(\d+): (error|note): (.*)", line) for line in done.stdout.splitlines()]
    found = {int(line[1]): (line[2], line[3]) for line in said if line}
    expected = {
        number: match.groups()
        for number, line in enumerate(lines, start=1)
        if (match := re.search(r"# (error|note): (.*)", line))
    }
    assert found.keys() == expected.keys(), done.stdout
    for number, (kind, words) in expected.items():
        assert found[number][0] == kind
        assert words in found[number][1], done.stdout
