"""Results hold what they have in common only once."""

import numpy as np

from impactlab.results.stack import Findings, Shared


def test_equal_labels_and_attributes_are_one_object_and_others_stay():
    def found(value, units="m"):
        edges = (("edge",), np.array([0.0, 1.0]), {"units": "m"})
        return Findings({"x": (("body",), np.array([value]), {"units": units})}, {"edge": edges}, {"step": value})

    shared = Shared()
    first, second, third = (shared(found(*item)) for item in ((1.0,), (2.0,), (3.0, "N")))
    assert second.coordinates["edge"][1] is first.coordinates["edge"][1]
    assert second.variables["x"][2] is first.variables["x"][2]
    assert [item.variables["x"][1].item() for item in (first, second, third)] == [1.0, 2.0, 3.0]
    assert third.variables["x"][2] == {"units": "N"}
    assert third.attributes == {"step": 3.0}
