"""Puts packages into an order in which each one comes after those it depends on.

Pure: names in, order out.
"""

from collections.abc import Iterable
from typing import Protocol, TypeVar

from obk_interfaces.errors import DependencyError

__all__ = ["order_by_dependency"]


class _Dependent(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def depends(self) -> tuple[str, ...]: ...


_P = TypeVar("_P", bound=_Dependent)


def order_by_dependency(packages: Iterable[_P]) -> tuple[_P, ...]:
    """Order by dependency, and by name where dependencies leave it open.

    Dependencies on packages outside the given ones are passed over.

    Raises:
        DependencyError: there is a circle; the text names its members.
    """
    waiting = {p.name: p for p in sorted(packages, key=lambda p: p.name)}
    ordered: list[_P] = []
    while waiting:
        ready = next((p for p in waiting.values() if waiting.keys().isdisjoint(p.depends)), None)
        if ready is None:
            raise DependencyError("packages depend on one another: " + _circle(waiting))
        ordered.append(waiting.pop(ready.name))
    return tuple(ordered)


def _circle(waiting: dict[str, _P]) -> str:
    """Walk from the first package until a name comes twice; every waiting one leads on."""
    trail = [next(iter(waiting))]
    while trail[-1] not in trail[:-1]:
        trail.append(next(name for name in waiting[trail[-1]].depends if name in waiting))
    return " -> ".join(trail[trail.index(trail[-1]) :])
