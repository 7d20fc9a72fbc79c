"""Memoized functions: of a model, and of small arrays, for which networks of one structure ask again and again.

Results depend on the arguments alone and are read-only.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np

Result = TypeVar("Result")

MOST, SMALL = 64, 4096
"""Results of each function that are remembered, and bytes of an array up to which they are: larger ones differ."""


class _Content(NamedTuple):
    """An array as it is looked up."""

    shape: tuple[int, ...]
    kind: str
    data: bytes

    @classmethod
    def of(cls, array: np.ndarray) -> _Content:
        return cls(array.shape, array.dtype.str, array.tobytes())

    def array(self) -> np.ndarray:
        return np.frombuffer(self.data, self.kind).reshape(self.shape)


def remembered(function: Callable[..., Result]) -> Callable[..., Result]:
    """Let a function of arrays and hashable arguments remember its last results, up to a call of ``cache_clear``."""

    @functools.lru_cache(maxsize=MOST)
    def known(*keys: Any) -> Result:
        result = function(*(key.array() if isinstance(key, _Content) else key for key in keys))
        for item in result if isinstance(result, tuple) else (result,):
            if isinstance(item, np.ndarray):
                item.setflags(write=False)
        return result

    @functools.wraps(function)
    def looked_up(*arguments: Any) -> Result:
        keys = []
        for item in arguments:
            if isinstance(item, np.ndarray):
                if item.nbytes > SMALL:
                    return function(*arguments)
                item = _Content.of(item)
            keys.append(item)
        return known(*keys)

    looked_up.cache_clear = known.cache_clear  # type: ignore[attr-defined]
    return looked_up


def kept(function: Callable[..., Result]) -> Callable[..., Result]:
    """Keep what a function of a model, arrays and hashable arguments returns for as long as the model lives.

    Arrays that are returned are read-only.
    """

    @functools.wraps(function)
    def known(model: Any, *arguments: Any) -> Result:
        results = model.__dict__.setdefault("_kept", {})
        key = function, *(_Content.of(item) if isinstance(item, np.ndarray) else item for item in arguments)
        if key not in results:
            results[key] = function(model, *arguments)
            if isinstance(results[key], np.ndarray):
                results[key].setflags(write=False)
        return results[key]  # type: ignore[no-any-return]

    return known


def keep(function: Callable[..., Result], model: Any, *arguments: Any, value: Result) -> None:
    """Let a function that is `kept` return a value that was found elsewhere."""
    key = (_Content.of(item) if isinstance(item, np.ndarray) else item for item in arguments)
    model.__dict__.setdefault("_kept", {})[(function.__wrapped__, *key)] = value  # type: ignore[attr-defined]
