"""Kernels of the laws of a network as text, evaluated at the states of snapshots."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np

from impactlab.assembly.model import Model
from impactlab.records.formulas import COLUMN, NUMBER, Evaluate, evaluator, formula_text
from impactlab.results.snapshot import places_of

_compiled: Callable[..., Evaluate] = cache(evaluator)


@dataclass(frozen=True, eq=False)
class LawKernel:
    """A kernel of the members of one class: contacts, couplings or bodies; all plain data.

    Attributes
    ----------
    kinematic : tuple of str
        Kinematic arguments that the kernel takes.
    members : (member,) ndarray
        Places of the members among all contacts, couplings or bodies.
    states : (state, member) ndarray
        Places of the states that it takes among all states of the network.
    numbers : (member, number) ndarray
        The other fields that it takes.
    """

    text: str
    name: str
    sources: tuple[str, ...]
    kinematic: tuple[str, ...]
    members: np.ndarray
    states: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(cls, name: str, laws: Sequence[Any], owners: Sequence[str], places: Mapping[str, int]) -> list[Self]:
        """Return the kernels of a name of some laws, class by class; laws without one are left out."""
        classes = dict.fromkeys(type(law) for law in laws if law.has_kernel(name))
        result = []
        for kind in classes:
            members = np.array([place for place, law in enumerate(laws) if type(law) is kind])
            kinematic, fields = kind.arguments(name)
            known = kind.state_names()
            states = [item for item in fields if item in known]
            numbers = [item for item in fields if item not in known]
            columns = [*kinematic, *states]
            sources = tuple(
                COLUMN.format(columns.index(item)) if item in columns else NUMBER.format(numbers.index(item))
                for item in (*kinematic, *fields)
            )
            label = f"{kind.__name__}_{name}"
            rows = [[places[f"{owners[member]}.{state}"] for member in members] for state in states]
            values = [[float(getattr(laws[member], item)) for item in numbers] for member in members]
            result.append(
                cls(
                    formula_text(getattr(kind, name), label),
                    label,
                    sources,
                    kinematic,
                    members,
                    np.array(rows, dtype=np.int64).reshape(len(states), len(members)),
                    np.array(values).reshape(len(members), len(numbers)),
                )
            )
        return result

    def __call__(self, kinematic: Mapping[str, np.ndarray], states: np.ndarray) -> np.ndarray:
        """Return the values of all members, (sample, member, lane).

        Kinematic arguments are of all contacts, couplings or bodies, (sample, place, lane), as are states.
        """
        columns = [kinematic[item][:, self.members] for item in self.kinematic]
        columns += [states[:, rows] for rows in self.states]
        samples, lanes = states.shape[0], states.shape[2]
        shape = len(columns), len(self.members), samples * lanes
        packed = np.empty((shape[0], shape[1], samples, lanes))
        for own, column in zip(packed, columns, strict=True):
            own[:] = column.transpose(1, 0, 2)
        result = np.empty((len(self.members), samples * lanes))
        _compiled(self.text, self.name, self.sources)(packed.reshape(shape), self.numbers, result)
        return result.reshape(len(self.members), samples, lanes).transpose(1, 0, 2)


@dataclass(frozen=True, eq=False)
class LawKernels:
    """The kernels of a network from which powers and stored energies follow."""

    coupling_forces: list[LawKernel]  # of couplings that are not linear
    coupling_energies: list[LawKernel]
    contact_energies: list[LawKernel]
    residuals: list[LawKernel]
    residual_energies: list[LawKernel]

    @classmethod
    def of(cls, model: Model) -> Self:
        """Return the kernels of a model."""
        places = places_of([name for name, _ in model.kicks.states])
        bodies, contacts, couplings = model.bodies, model.contacts, model.couplings
        linear = [law.linear != (0.0, 0.0) for law in couplings.laws]
        laws = [_NoKernels() if known else law for law, known in zip(couplings.laws, linear, strict=True)]
        of_bodies = bodies.oscillators, bodies.names, places
        return cls(
            LawKernel.of("force", laws, couplings.names, places),
            LawKernel.of("potential", laws, couplings.names, places),
            LawKernel.of("potential", contacts.laws, contacts.names, places),
            LawKernel.of("residual", *of_bodies),
            LawKernel.of("residual_potential", *of_bodies),
        )


class _NoKernels:
    """In the place of a law whose forces are known otherwise."""

    def has_kernel(self, name: str) -> bool:
        """Whether there is a kernel: there is none."""
        return False


def added(kernels: Sequence[LawKernel], kinematic: Mapping[str, np.ndarray], states: np.ndarray) -> np.ndarray:
    """Return the values of all members of some kernels at their places, 0 at others, (sample, place, lane)."""
    result = np.zeros_like(next(iter(kinematic.values())))
    for kernel in kernels:
        result[:, kernel.members] = kernel(kinematic, states)
    return result
