"""Numbers by name that do not change."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping
from typing import Any, Generic, TypeVar

Value = TypeVar("Value", bound=Hashable)


class Weights(Mapping[str, Value], Generic[Value]):
    """Numbers, or rows of numbers, by name, which do not change and can be compared, hashed and pickled."""

    __slots__ = ("_numbers",)

    def __init__(self, numbers: Mapping[str, Value]) -> None:
        self._numbers = dict(numbers)

    def __getitem__(self, name: str) -> Value:
        return self._numbers[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __hash__(self) -> int:
        return hash(frozenset(self._numbers.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return Weights, (self._numbers,)

    def __repr__(self) -> str:
        return repr(self._numbers)
