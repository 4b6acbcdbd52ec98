"""Find the code that a node's start leads to: functions, methods and modules, followed by name.

A class counts as a whole, except methods of its bases that it overrides. Attributes of objects, the
runtime library and packages outside the workspace are not followed.
"""

import ast
import builtins
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

from obk_cli.source_analysis.class_hierarchy import ClassSource, Function
from obk_cli.source_analysis.imports import EntryFunction
from obk_cli.source_analysis.modules import (
    Imported,
    Module,
    ModuleLibrary,
    import_origin,
    words_in,
)

__all__ = ["CodeBlock", "reached_code"]

_MOST_BLOCKS = 5_000
"""Maximum number of functions and methods examined per node."""
_LIBRARIES = ("obelisk_py", "rclpy")
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


@dataclass(frozen=True, kw_only=True, eq=False)
class CodeBlock:
    """Statements with one scope: a function, a method, or the body of a class or module."""

    module: Module
    roots: tuple[ast.AST, ...]
    function: Function | None = None
    owner: ast.ClassDef | None = None
    """The class to which the method or body belongs."""
    has_scope: bool = True
    """Whether names bound in it are local, unlike in the body of a class or module."""

    @cached_property
    def nodes(self) -> tuple[ast.AST, ...]:
        """Its syntax, without annotations, and without functions and classes that are blocks."""
        return tuple(node for root in self.roots for node in _walk(root, self.has_scope))

    def name_of(self, expression: ast.AST) -> str | None:
        """The full name that `a.b.C` refers to, `hash` for a builtin; None if unknown."""
        parts: list[str] = []
        while isinstance(expression, ast.Attribute):
            parts.append(expression.attr)
            expression = expression.value
        head = self._head(expression.id) if isinstance(expression, ast.Name) else None
        return None if head is None else ".".join((head, *reversed(parts)))

    def _head(self, name: str) -> str | None:
        if name in self._local:
            return self._local[name]
        if name not in self.module.names:
            return name if hasattr(builtins, name) else None
        match self.module.names[name]:
            case None:
                return None
            case Imported(dotted=dotted):
                return dotted
        return f"{self.module.name}.{name}"

    @cached_property
    def _local(self) -> Mapping[str, str | None]:
        """What local names refer to: imports within a function; None for all others."""
        if not self.has_scope:
            return {}
        names: dict[str, str | None] = {}
        for node in self.nodes:
            match node:
                case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
                    names[name] = None
                case (
                    ast.FunctionDef(name=name)
                    | ast.AsyncFunctionDef(name=name)
                    | ast.ClassDef(name=name)
                ) if node not in self.roots:
                    names[name] = None
                case ast.Import(names=aliases):
                    for alias in aliases:
                        top = alias.name.partition(".")[0]
                        names[alias.asname or top] = alias.name if alias.asname else top
                case ast.ImportFrom(names=aliases):
                    origin = import_origin(node, self.module.name, self.module.is_package)
                    names.update((a.asname or a.name, f"{origin}.{a.name}") for a in aliases)
        return names


def _walk(root: ast.AST, has_scope: bool) -> Iterator[ast.AST]:
    pending = [root]
    while pending:
        node = pending.pop()
        yield node
        left_out = {id(getattr(node, name, None)) for name in ("annotation", "returns")}
        if isinstance(node, ast.If) and "TYPE_CHECKING" in words_in(node.test):
            left_out.update(map(id, node.body))
        if not has_scope:
            left_out.update(id(c) for c in ast.iter_child_nodes(node) if _is_definition(c))
        children = [child for child in ast.iter_child_nodes(node) if id(child) not in left_out]
        pending += reversed(children)


def _is_definition(node: ast.AST) -> bool:
    return isinstance(node, _DEFINITIONS)


def reached_code(entry: EntryFunction, library: ModuleLibrary) -> Iterator[CodeBlock]:
    """The code that an entry point runs, and all code that it uses, each block once.

    Raises:
        UnreadableSourceError: a module on the path is not valid Python.
    """
    walk = _Walk(library)
    if not _is_of_library(entry[0].name):
        walk.start(*entry)
    for _ in range(_MOST_BLOCKS):
        if not walk.pending:
            return
        block = walk.pending.pop(0)
        walk.follow(block)
        yield block


class _Walk:
    def __init__(self, library: ModuleLibrary) -> None:
        self.pending: list[CodeBlock] = []
        self._library = library
        self._modules: set[str] = set()
        self._names: set[str] = set()
        self._functions: set[Function] = set()
        self._classes: set[tuple[ast.ClassDef, frozenset[str]]] = set()

    def start(self, module: Module, statements: list[ast.stmt]) -> None:
        """Add the statements of an entry point, and its module."""
        if statements is module.tree.body:
            self._modules.add(module.name)
            self._body(module, statements)
        else:
            self._module(module)
            self.pending.append(CodeBlock(module=module, roots=tuple(statements)))

    def follow(self, block: CodeBlock) -> None:
        """Record what a block uses."""
        bases = {id(base) for base in block.owner.bases} if block.owner else set()
        for node in block.nodes:
            is_name = isinstance(node, ast.Name | ast.Attribute) and id(node) not in bases
            name = block.name_of(node) if is_name else None
            if name is not None and "." in name and name not in self._names:
                self._names.add(name)
                self._definition(name, frozenset())

    def _definition(self, name: str, overridden: frozenset[str]) -> None:
        definition = None if _is_of_library(name) else self._library.definition(name)
        if definition is None or _is_of_library(definition.module.name):
            return
        module, node = definition.module, definition.node
        self._module(module)
        if isinstance(node, ast.ClassDef):
            self._class(ClassSource(module, node), overridden)
        elif not isinstance(node, ast.expr):
            self._function(node, module, None)

    def _module(self, module: Module) -> None:
        """Add the code that runs when a module is imported."""
        if module.name in self._modules:
            return
        self._modules.add(module.name)
        self._body(module, [s for s in module.tree.body if not _is_main(s)])

    def _body(self, module: Module, statements: list[ast.stmt]) -> None:
        roots = tuple(s for s in statements if not _is_definition(s))
        self.pending.append(CodeBlock(module=module, roots=roots, has_scope=False))

    def _class(self, source: ClassSource, overridden: frozenset[str]) -> None:
        """Add a class, without methods that a subclass overrides."""
        module, node = source.module, source.node
        if (node, overridden) in self._classes:
            return
        self._classes.add((node, overridden))
        inner = [s for s in node.body if isinstance(s, ast.ClassDef)]
        body = [s for s in node.body if not _is_definition(s)]
        outside = CodeBlock(
            module=module,
            roots=(*node.decorator_list, *node.bases, *body),
            owner=node,
            has_scope=False,
        )
        self.pending.append(outside)
        for method in source.methods():
            if method.name not in overridden:
                self._function(method, module, node)
        own = {m.name for m in source.methods() if "super" not in words_in(m)}
        for base in node.bases:
            name = outside.name_of(base.value if isinstance(base, ast.Subscript) else base)
            if name is not None and "." in name:
                self._definition(name, overridden | own)
        for one in inner:
            self._class(ClassSource(module, one), frozenset())

    def _function(self, function: Function, module: Module, owner: ast.ClassDef | None) -> None:
        if function not in self._functions:
            self._functions.add(function)
            block = CodeBlock(module=module, roots=(function,), function=function, owner=owner)
            self.pending.append(block)


def _is_of_library(name: str) -> bool:
    return name.partition(".")[0] in _LIBRARIES


def _is_main(statement: ast.stmt) -> bool:
    """Whether it is `if __name__ == "__main__"`, which an import does not run."""
    return isinstance(statement, ast.If) and "__name__" in words_in(statement.test)
