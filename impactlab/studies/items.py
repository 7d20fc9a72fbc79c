"""What a study simulates, as descriptions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from impactlab import Network


class Item(NamedTuple):
    """One simulation of a study: pure data, ``il.simulate(network, **options)``."""

    key: str
    network: Network
    options: dict[str, Any]


class SweepItem(NamedTuple):
    """One sweep of a study: ``il.sweep(make_network, over, **options)``. No point may be refused."""

    key: str
    make_network: Callable[..., Network | tuple[Network, Mapping[str, Any]]]
    over: Mapping[str, Sequence[Any]]
    options: dict[str, Any]
