"""Follow a class and its bases through imports, and find unimplemented abstract methods."""

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from obelisk_spec.suggestions import near_names
from obk_cli.config.environment import MissingMethod
from obk_cli.source_analysis.modules import (
    Module,
    ModuleLibrary,
    at_top_level,
    dotted_name,
    span_of,
    stored_names,
)

__all__ = ["ClassSource", "Function", "Lineage", "lineage_of"]

Function = ast.FunctionDef | ast.AsyncFunctionDef

_HARMLESS = ("rclpy", "abc", "typing", "typing_extensions", "object")
"""Modules whose base classes register and implement nothing of Obelisk's."""
_NODE_CLASS = "obelisk_py.core.node.ObeliskNode"
_ROBOT_CLASS = "obelisk_py.core.robot.ObeliskRobot"
_LIBRARY = "obelisk_py.core."
_ABSTRACT = ("abc.abstractmethod", "abstractmethod")


@dataclass(frozen=True)
class ClassSource:
    """A class and the module that defines it."""

    module: Module
    node: ast.ClassDef

    @property
    def full_name(self) -> str:
        """Module and class."""
        return f"{self.module.name}.{self.node.name}"

    @property
    def is_of_library(self) -> bool:
        """Whether it is a base class of the runtime library."""
        return self.module.name.startswith(_LIBRARY)

    def method(self, name: str) -> Function | None:
        """The method with that name that the class itself defines."""
        return self._by_name.get(name)

    def methods(self) -> Iterable[Function]:
        """The methods that the class itself defines."""
        return self._by_name.values()

    @cached_property
    def _by_name(self) -> Mapping[str, Function]:
        """Cached, because it is needed for every call in a constructor."""
        methods: dict[str, Function] = {}
        for statement in at_top_level(self.node.body):
            if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef)):
                methods.setdefault(statement.name, statement)
        return methods

    @cached_property
    def defined_names(self) -> tuple[str, ...]:
        """The names that its body binds, once for each binding, and those within `if` and `try`."""
        names: list[str] = []
        for statement in at_top_level(self.node.body):
            if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                names.append(statement.name)
            else:
                names += stored_names(statement)
        return tuple(names)

    def has(self, name: str) -> bool:
        """Whether the class itself defines an attribute of that name."""
        return name in self.defined_names


@dataclass(frozen=True, slots=True, kw_only=True)
class Lineage:
    """A class, then its bases, nearest first."""

    classes: tuple[ClassSource, ...]
    is_whole: bool
    """Whether every base was found."""

    @property
    def is_node(self) -> bool:
        """Whether the class is an Obelisk node."""
        return any(c.full_name == _NODE_CLASS for c in self.classes)

    @property
    def can_damp(self) -> bool | None:
        """Whether a robot's class defines how it brakes; None if unknown."""
        own = [c for c in self.classes if c.full_name != _ROBOT_CLASS]
        if not self.is_whole or len(own) == len(self.classes):
            return None
        return any(c.has("apply_damping") or c.has("_can_damp") for c in own)

    def method(self, name: str, start: int = 0) -> tuple[int, Function] | None:
        """The method that a call reaches and the index of its class, searching from `start`."""
        for index, source in enumerate(self.classes[start:], start):
            found = source.method(name)
            if found is not None:
                return index, found
        return None

    def plain_method(self, name: str) -> tuple[ClassSource, Function] | None:
        """The undecorated method of the user's classes that is certainly `self.name`."""
        reached = self.method(name)
        if reached is None:
            return None
        index, method = reached
        source = self.classes[index]
        names = [n for c in self.classes[: index + 1] for n in c.defined_names]
        is_plain = not method.decorator_list and names.count(name) == 1
        return (source, method) if is_plain and not source.is_of_library else None

    def missing_methods(self) -> Iterator[MissingMethod]:
        """Abstract methods that no class implements; empty if a base is unknown."""
        if not self.is_whole:
            return
        own = [m.name for c in self.classes if not c.is_of_library for m in c.methods()]
        seen: set[str] = set()
        for source in self.classes:
            for method in source.methods():
                is_first = not any(c.has(method.name) for c in self._before(source))
                if method.name not in seen and is_first and _is_abstract(method, source.module):
                    yield MissingMethod(
                        name=method.name,
                        span=span_of(method, source.module.source),
                        near=near_names(method.name, own),
                    )
                seen.add(method.name)

    def _before(self, source: ClassSource) -> tuple[ClassSource, ...]:
        return self.classes[: self.classes.index(source)]


def lineage_of(source: ClassSource, library: ModuleLibrary) -> Lineage:
    """The class and everything that it inherits from."""
    classes, is_whole = _order(source, library, ())
    return Lineage(classes=tuple(classes), is_whole=is_whole)


def _order(
    source: ClassSource, library: ModuleLibrary, below: tuple[ClassSource, ...]
) -> tuple[list[ClassSource], bool]:
    """The class and its bases in the order of Python, and whether every base was found."""
    orders: list[list[ClassSource]] = []
    is_whole = not source.node.decorator_list
    for base in source.node.bases:
        expression = base.value if isinstance(base, ast.Subscript) else base
        dotted = dotted_name(expression, source.module) or ""
        if dotted.partition(".")[0] in _HARMLESS:
            continue
        definition = library.definition(dotted)
        if definition is None or not isinstance(definition.node, ast.ClassDef):
            is_whole = False
            continue
        base_source = ClassSource(definition.module, definition.node)
        if base_source in below or base_source == source:
            is_whole = False
            continue
        order, base_is_whole = _order(base_source, library, (*below, source))
        orders.append(order)
        is_whole = is_whole and base_is_whole
    return [source, *_merged([*orders, [order[0] for order in orders]])], is_whole


def _merged(orders: list[list[ClassSource]]) -> Iterator[ClassSource]:
    """Merge orders as Python does (C3): each class comes before all that any order has after it."""
    while orders := [order for order in orders if order]:
        later = {source for order in orders for source in order[1:]}
        # Python rejects contradictory orders; the first one then counts.
        first = next((order[0] for order in orders if order[0] not in later), orders[0][0])
        yield first
        orders = [[source for source in order if source != first] for order in orders]


def _is_abstract(method: Function, module: Module) -> bool:
    return any(dotted_name(d, module) in _ABSTRACT for d in method.decorator_list)
