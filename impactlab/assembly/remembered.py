"""Functions of small arrays that remember what they returned: networks of one structure ask the same again and again.

What they return is a function of the arguments alone, and read-only.
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
                item = _Content(item.shape, item.dtype.str, item.tobytes())
            keys.append(item)
        return known(*keys)

    looked_up.cache_clear = known.cache_clear  # type: ignore[attr-defined]
    return looked_up
