"""How bugs are planted: what is returned by functions of the real code is changed, or a name in it."""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from scenes import changed

from impactlab.simulation import growing_ensemble
from impactlab.step_control.measured.segments import SEED
from planted.detectors import Scene

Plant = Callable[[pytest.MonkeyPatch], None]
Change = Callable[[Any], Any]


@dataclass(frozen=True)
class Bug:
    """A wrong variant of the code.

    Attributes
    ----------
    name : str
        What is wrong.
    scene : Scene
        Where it must show.
    plant : callable
        Puts it into the code.
    in_reference : bool
        Whether it is in an exact law, so that the simulation may be that of the right code.
    """

    name: str
    scene: Scene
    plant: Plant
    in_reference: bool = False


def forget() -> None:
    """Let functions that remember what they returned forget it; compiled code is kept."""
    for name, module in list(sys.modules.items()):
        if name.startswith("impactlab."):
            without_code = name.startswith(
                ("impactlab.linear", "impactlab.step_control")
            )  # elsewhere some are compiled
            for _, function in inspect.getmembers(module, callable if without_code else inspect.isfunction):
                if callable(getattr(function, "cache_clear", None)):
                    function.cache_clear()


def returned(module: Any, name: str, change: Callable[..., Any]) -> Plant:
    """Let a function return ``change(result, *arguments)``."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = getattr(module, name)

        def wrong(*arguments: Any, **options: Any) -> Any:
            return change(original(*arguments, **options), *arguments)

        monkeypatch.setattr(module, name, wrong)

    return plant


def called(module: Any, name: str, change: Callable[..., tuple[Any, ...]]) -> Plant:
    """Call a function with ``change(*arguments)`` in the place of its arguments."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        original = getattr(module, name)
        monkeypatch.setattr(module, name, lambda *arguments: original(*change(*arguments)))

    return plant


def instead(module: Any, name: str, value: Any) -> Plant:
    """Put something else in the place of a name."""
    return lambda monkeypatch: monkeypatch.setattr(module, name, value)


def both(*plants: Plant) -> Plant:
    """Plant several changes, which are one bug together."""

    def plant(monkeypatch: pytest.MonkeyPatch) -> None:
        for item in plants:
            item(monkeypatch)

    return plant


def planned(change: Change) -> Plant:
    """Change the plan of every simulation, not those with which its step is measured, which would see the bug."""
    return returned(
        growing_ensemble, "make_plan", lambda plan, model, request: plan if request.seed == SEED else change(plan)
    )


def in_plan(**changes: Change) -> Plant:
    """Change fields of the plan, named ``part__field``: each by a function of the plan."""
    return planned(lambda plan: changed(plan, **{name: change(plan) for name, change in changes.items()}))


def coefficients(change: Callable[[Any, np.ndarray], None]) -> Plant:
    """Change the numbers of the method, (phase, column, body), in place."""

    def of_plan(plan: Any) -> Any:
        result = plan.method.coefficients.copy()
        change(plan, result)
        return changed(plan, method__coefficients=result)

    return planned(of_plan)


def text(old: str, new: str) -> Plant:
    """Change the generated text of the forces."""

    def of_plan(plan: Any) -> Any:
        assert old in plan.forces.text
        return changed(plan, forces__text=plan.forces.text.replace(old, new))

    return planned(of_plan)
