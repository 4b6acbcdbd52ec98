"""Python modules as text: what a name refers to, and the value of an expression.

This module follows names through imports to their definitions. It does not open files or run code.
"""

import ast
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Final

from obk_cli.diagnostics.source import SourceFile, Span

__all__ = [
    "BIND_UNSEEN",
    "UNKNOWN",
    "Definition",
    "Dotted",
    "FoundSource",
    "Imported",
    "KnownValues",
    "LoadModule",
    "Module",
    "ModuleLibrary",
    "UnreadableSourceError",
    "Value",
    "at_top_level",
    "dotted_name",
    "import_origin",
    "message_type",
    "parse_module",
    "span_of",
    "stored_names",
    "value_of",
    "words_in",
]

BIND_UNSEEN = ("exec", "globals", "locals", "vars", "modules", "builtins", "__getattr__")
"""Names whose use can bind other names of a module."""
_TYPE_PARAMETERS = ("TypeVar", "ParamSpec", "TypeVarTuple")
"""Python 3.12 syntax, `class Filter[T]`."""
_DOUBLE_UNDERSCORE = re.compile(r"\b__[A-Za-z]\w*")
_LONGEST_CHAIN = 20
"""Maximum number of imports followed for one name."""
_LONGEST_TEXT = 1000
"""Longer texts are unknown, because each may contain another one several times."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundSource:
    """The text of a module."""

    source: SourceFile
    is_package: bool = False
    """Whether it is the `__init__` of a package, from which relative imports start."""


@dataclass(frozen=True, slots=True)
class Imported:
    """A name bound by an import."""

    dotted: str


Binding = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef | ast.expr | Imported | None
"""What a name of a module refers to; None if it is bound more than once, or computed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Module:
    """One module."""

    name: str
    source: SourceFile
    tree: ast.Module
    is_package: bool
    """Whether it is the `__init__` of a package."""
    names: Mapping[str, Binding]
    has_more_names: bool
    """Whether `import *` or `__getattr__` adds unknown names."""

    @cached_property
    def bound_names(self) -> frozenset[str] | None:
        """Every name bound in any scope; None if some are unknown."""
        if self.has_more_names or words_in(self.tree) & {*BIND_UNSEEN}:
            return None
        return frozenset(stored_names(self.tree))

    @cached_property
    def stored_attributes(self) -> frozenset[str | None]:
        """The full names of attributes that the module assigns: `pkg.constants.KEY`."""
        return frozenset(
            dotted_name(node, self)
            for node in ast.walk(self.tree)
            if isinstance(node, ast.Attribute) and not isinstance(node.ctx, ast.Load)
        )


@dataclass(frozen=True, slots=True)
class Definition:
    """What a name refers to, and the module in which it is evaluated."""

    module: Module
    node: ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef | ast.expr


LoadModule = Callable[[str], Module | None]
"""Dotted name -> module; None if it should not be followed."""


class UnreadableSourceError(Exception):
    """A module that is not valid Python, with the message and the location."""

    def __init__(self, message: str, span: Span) -> None:
        super().__init__(message)
        self.message = message
        self.span = span


class ModuleLibrary:
    """Modules, each read once."""

    def __init__(self, load: LoadModule) -> None:
        self._load = load
        self._modules: dict[str, Module | None] = {}

    def module(self, name: str) -> Module | None:
        """The module with this name; None if its source is not available.

        Raises:
            UnreadableSourceError: the source is not valid Python.
        """
        if name not in self._modules:
            self._modules[name] = self._load(name)
        return self._modules[name]

    def definition(self, dotted: str) -> Definition | None:
        """The class, function or value that a dotted name refers to, through re-exports.

        Raises:
            UnreadableSourceError: a module on the path is not valid Python.
        """
        for _ in range(_LONGEST_CHAIN):
            name, _, attribute = dotted.rpartition(".")
            module = self.module(name) if name else None
            if module is None:
                return None
            match module.names.get(attribute):
                case None:
                    return None
                case Imported(dotted=further):
                    dotted = further
                case node:
                    return Definition(module, node)
        return None


def dotted_name(expression: ast.expr, module: Module) -> str | None:
    """The full name of `a.b.C` in a module: `pkg.a.b.C`; None for anything else."""
    parts: list[str] = []
    while isinstance(expression, ast.Attribute):
        parts.append(expression.attr)
        expression = expression.value
    if not isinstance(expression, ast.Name):
        return None
    bound = module.names.get(expression.id, expression)
    if bound is None:
        return None
    if isinstance(bound, Imported):
        head = bound.dotted
    else:
        is_own = expression.id in module.names
        head = f"{module.name}.{expression.id}" if is_own else expression.id
    return ".".join((head, *reversed(parts)))


def span_of(node: ast.expr | ast.stmt | ast.alias, source: SourceFile) -> Span:
    """The first line of a syntax node; AST columns are bytes, ours are characters."""
    line = source.line(node.lineno)
    start = len(line.encode()[: node.col_offset].decode(errors="replace"))
    end_offset = node.end_col_offset if node.end_lineno == node.lineno else None
    text = line.rstrip().encode()[:end_offset].decode(errors="replace")
    return Span.at(source, node.lineno, start + 1, max(len(text) - start, 1))


def parse_module(name: str, found: FoundSource) -> Module:
    """Parse a module.

    Raises:
        UnreadableSourceError: the text is not valid Python.
    """
    tree = _syntax_tree(found.source)
    if any(not word.endswith("__") for word in _DOUBLE_UNDERSCORE.findall(found.source.text)):
        _mangle_private_names(tree)
    statements = list(at_top_level(tree.body))
    names: dict[str, Binding] = {}
    for statement in statements:
        for bound, value in _bindings(statement, name, found.is_package):
            is_same = bound not in names or names[bound] == value
            names[bound] = value if is_same else None
    if "global" in found.source.text:  # few modules need the slow walk
        names.update(dict.fromkeys(_names_of_functions(tree)))
    stars = any(
        isinstance(s, ast.ImportFrom) and any(alias.name == "*" for alias in s.names)
        for s in statements
    )
    return Module(
        name=name,
        source=found.source,
        tree=tree,
        is_package=found.is_package,
        names=names,
        has_more_names=stars or "__getattr__" in names,
    )


def _syntax_tree(source: SourceFile) -> ast.Module:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return ast.parse(source.text)
    except SyntaxError as error:
        line = min(max(error.lineno or 1, 1), len(source.lines))
        column = min(max(error.offset or 1, 1), len(source.line(line)) + 1)
        raise UnreadableSourceError(error.msg, Span.at(source, line, column)) from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise UnreadableSourceError(str(error), Span.at(source, 1, 1)) from error


def _mangle_private_names(tree: ast.Module) -> None:
    """Rename `__x` in the body of a class `C` to `_C__x`, as Python does."""
    pending: list[tuple[ast.AST, str]] = [(tree, "")]
    while pending:
        node, owner = pending.pop()
        inside = node.name if isinstance(node, ast.ClassDef) else owner
        body = {id(part) for part in (node.body if isinstance(node, ast.ClassDef) else ())}
        pending += [(c, inside if id(c) in body else owner) for c in ast.iter_child_nodes(node)]
        prefix = owner.lstrip("_")
        if not prefix or isinstance(node, ast.keyword | ast.alias):
            continue
        for place in ("id", "attr", "name", "arg"):
            name = getattr(node, place, None)
            if isinstance(name, str) and name.startswith("__") and not name.endswith("__"):
                setattr(node, place, f"_{prefix}{name}")


def at_top_level(statements: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """The statements that bind names of a module or class, including those in `if` and `try`."""
    for statement in statements:
        yield statement
        for part in ("body", "handlers", "orelse", "finalbody"):
            inner = getattr(statement, part, ())
            if isinstance(statement, ast.If | ast.Try | ast.With | ast.ExceptHandler):
                yield from at_top_level(inner)


def _bindings(statement: ast.stmt, module: str, is_package: bool) -> Iterator[tuple[str, Binding]]:
    match statement:
        case ast.ClassDef(name=name) | ast.FunctionDef(name=name) | ast.AsyncFunctionDef(name=name):
            yield name, statement
        case ast.Import(names=aliases):
            for alias in aliases:
                top = alias.name.partition(".")[0]
                yield (alias.asname, Imported(alias.name)) if alias.asname else (top, Imported(top))
        case ast.ImportFrom(names=aliases):
            origin = import_origin(statement, module, is_package)
            for alias in aliases:
                yield alias.asname or alias.name, Imported(f"{origin}.{alias.name}")
        case ast.Assign(targets=targets, value=value):
            for target in targets:
                if isinstance(target, ast.Name):
                    yield target.id, value
        case ast.AnnAssign(target=ast.Name(id=name), value=ast.expr() as value):
            yield name, value
    yield from ((name, None) for name in _computed_names(statement))


def _computed_names(statement: ast.stmt | ast.ExceptHandler) -> Iterator[str]:
    """The names that a loop, `+=`, `del` or other syntax binds."""
    parts: Iterable[ast.AST] = ()
    match statement:
        case ast.ClassDef() | ast.FunctionDef() | ast.AsyncFunctionDef() | ast.AnnAssign():
            pass
        case ast.Import() | ast.ImportFrom() | ast.Try():
            pass
        case ast.Assign(targets=targets):
            parts = (target for target in targets if not isinstance(target, ast.Name))
        case ast.If(test=test):
            parts = (test,)
        case ast.With(items=items):
            parts = items
        case ast.ExceptHandler(name=name):
            yield from [name] if name else []
        case _:
            parts = (statement,)
    for part in parts:
        yield from stored_names(part)


def _names_of_functions(tree: ast.Module) -> Iterator[str]:
    """The names of a module that its functions may assign."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Global):
            yield from node.names


def import_origin(statement: ast.ImportFrom, module: str, is_package: bool) -> str:
    """The module of `from x import y`, with leading dots resolved."""
    if not statement.level:
        return statement.module or ""
    parts = module.split(".")
    kept = parts[: len(parts) - statement.level + (1 if is_package else 0)]
    return ".".join((*kept, *([statement.module] if statement.module else [])))


def stored_names(tree: ast.AST) -> Iterator[str]:
    """Every name that a syntax tree binds, in any scope."""
    for node in ast.walk(tree):
        match node:
            case ast.Name(id=name, ctx=ast.Store() | ast.Del()):
                yield name
            case (
                ast.ClassDef(name=name)
                | ast.FunctionDef(name=name)
                | ast.AsyncFunctionDef(name=name)
            ):
                yield name
            case ast.alias(name=name, asname=asname):
                yield asname or name.partition(".")[0]
            case ast.arg(arg=name) | ast.MatchMapping(rest=str(name)):
                yield name
            case ast.ExceptHandler(name=str(name)):
                yield name
            case ast.MatchAs(name=str(name)) | ast.MatchStar(name=str(name)):
                yield name
            case ast.Global(names=names) | ast.Nonlocal(names=names):
                yield from names
            case _ if type(node).__name__ in _TYPE_PARAMETERS:
                yield str(getattr(node, "name", ""))


def words_in(tree: ast.AST) -> frozenset[str]:
    """Every name and attribute that is used."""
    return frozenset(
        node.id if isinstance(node, ast.Name) else node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Name | ast.Attribute)
    )


class Unknown(Enum):
    """A value computed at run time."""

    UNKNOWN = "unknown"


UNKNOWN: Final = Unknown.UNKNOWN


@dataclass(frozen=True, slots=True)
class Dotted:
    """A class, function or module, by its full name."""

    name: str


Value = str | bool | None | Dotted | Unknown
KnownValues = Mapping[str, Value]
"""Local names, such as a constructor's parameters."""

_MESSAGE = re.compile(r"(\w+)\.msg\.(?:_\w+\.)?([A-Z]\w*)")


def message_type(value: Value) -> str | None:
    """The message type of a class, `pkg/msg/Name`; None for anything else."""
    parts = _MESSAGE.fullmatch(value.name) if isinstance(value, Dotted) else None
    return f"{parts[1]}/msg/{parts[2]}" if parts else None


def value_of(
    expression: ast.expr | None, module: Module, library: ModuleLibrary, local: KnownValues
) -> Value:
    """The string, boolean, None or class that an expression evaluates to; no expression is None."""
    match expression:
        case None:
            return None
        case ast.Constant(value=str() | bool() | None as constant):
            return constant
        case ast.Name(id=name) if name in local:
            return local[name]
        case ast.BoolOp(op=ast.Or(), values=[first, second]):
            value = value_of(first, module, library, local)
            if value is UNKNOWN:
                return UNKNOWN
            return value or value_of(second, module, library, local)
        case ast.Compare(left=left, ops=[ast.Is() | ast.IsNot() as op], comparators=[right]):
            values = [value_of(side, module, library, local) for side in (left, right)]
            if UNKNOWN in values or None not in values:
                return UNKNOWN
            return (values[0] is values[1]) is isinstance(op, ast.Is)
        case ast.Name() | ast.Attribute():
            return _named(expression, module, library)
        case ast.BinOp(op=ast.Add()):
            terms = _terms(expression)
            return _joined(value_of(term, module, library, local) for term in terms)
        case ast.JoinedStr(values=parts):
            return _joined(value_of(part, module, library, local) for part in parts)
        case ast.FormattedValue(value=inner, conversion=-1, format_spec=None):
            return value_of(inner, module, library, local)
        case _:
            return UNKNOWN


def _terms(expression: ast.expr) -> list[ast.expr]:
    """The terms of a sum, in a loop because it may have more than Python can recurse into."""
    terms: list[ast.expr] = []
    while isinstance(expression, ast.BinOp) and isinstance(expression.op, ast.Add):
        terms.append(expression.right)
        expression = expression.left
    return [expression, *reversed(terms)]


def _joined(values: Iterable[Value]) -> Value:
    texts: list[str] = []
    for value in values:
        if not isinstance(value, str):
            return UNKNOWN
        texts.append(value)
    text = "".join(texts)
    return text if len(text) <= _LONGEST_TEXT else UNKNOWN


def _named(expression: ast.expr, module: Module, library: ModuleLibrary) -> Value:
    dotted = dotted_name(expression, module)
    if dotted is None or "." not in dotted:
        return UNKNOWN
    if _MESSAGE.fullmatch(dotted):
        return Dotted(dotted)
    found = library.definition(dotted)
    if found is None:
        return UNKNOWN
    if isinstance(expression, ast.Attribute) and dotted in module.stored_attributes:
        return UNKNOWN
    if isinstance(found.node, ast.expr):
        match found.node:
            case ast.Constant(value=str() | bool() | None as constant):
                return constant
            case ast.Name() | ast.Attribute():
                further = dotted_name(found.node, found.module)
                return Dotted(further) if further and _MESSAGE.fullmatch(further) else UNKNOWN
        return UNKNOWN
    return Dotted(f"{found.module.name}.{found.node.name}")
