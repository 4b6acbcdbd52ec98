"""What a node's class registers and declares: its constructors walked from the class up its bases.

Follows `super().__init__` with the values of its arguments, and the methods of `self` that are
used on the way. Whatever is computed at run time makes the answer "not known", never a guess.
"""

import ast
from dataclasses import dataclass, field, replace
from typing import Final

from obk_cli.code.calls import Scope, bound_arguments, register_call, scope_of
from obk_cli.code.lineage import ClassSource, Function, Lineage
from obk_cli.code.modules import Library
from obk_cli.code.parameters import declared_parameters
from obk_cli.code.values import UNKNOWN, Environment
from obk_cli.node_code import CodeComponent, CodeParameter

__all__ = ["Registrations", "registrations_of"]

_SURVIVES_SELF: Final = {"super", "isinstance", "type", "id", "print", "repr", "str", "hasattr"}
_DECLARES_ALL: Final = (
    "allow_undeclared_parameters",
    "automatically_declare_parameters_from_overrides",
)
_BRANCHES = (ast.If, ast.For, ast.AsyncFor, ast.While, ast.Try, ast.IfExp, ast.Match, ast.Lambda,
             ast.FunctionDef, ast.AsyncFunctionDef, ast.ListComp, ast.SetComp, ast.DictComp,
             ast.GeneratorExp)  # fmt: skip


@dataclass(slots=True)
class Registrations:
    """What was found; the two `knows_` turn False where something could not be seen."""

    components: dict[ast.Call, CodeComponent] = field(default_factory=dict)
    parameters: dict[str, CodeParameter] = field(default_factory=dict)
    knows_components: bool = True
    knows_parameters: bool = True


def registrations_of(lineage: Lineage, library: Library, *, has_arguments: bool) -> Registrations:
    """The components and parameters of a class; made with its defaults unless `has_arguments`."""
    walk = _Walk(lineage, library, has_arguments=has_arguments)
    walk.constructor(0, None)
    for name in sorted({m.name for c in lineage.classes for m in c.methods()}):
        if name.startswith("on_"):
            walk.method(name, 0, is_certain=False)
    walk.found.knows_components &= lineage.is_whole
    walk.found.knows_parameters &= lineage.is_whole
    return walk.found


class _Walk:
    def __init__(self, lineage: Lineage, library: Library, *, has_arguments: bool) -> None:
        self._has_arguments = has_arguments
        self.found = Registrations()
        self._lineage = lineage
        self._library = library
        self._visited: dict[Function, bool] = {}

    def constructor(self, start: int, call: tuple[ast.Call, Scope] | None) -> None:
        """The first constructor from `start` on, called with the arguments of `call`."""
        reached = self._lineage.method("__init__", start)
        if reached is None:
            return
        index, function = reached
        source = self._lineage.classes[index]
        is_open = call is None and self._has_arguments
        local = bound_arguments(function, source.module, call, self._library, is_open=is_open)
        self._body(index, function, local, is_certain=True)
        hands_on = any(
            isinstance(n, ast.Call)
            and isinstance(n.func, ast.Attribute)
            and n.func.attr == "__init__"
            for n in ast.walk(function)
        )
        if not hands_on:
            self._give_up()

    def method(self, name: str, start: int, *, is_certain: bool) -> None:
        """A method of the node, whatever it is called with."""
        reached = self._lineage.method(name, start)
        if reached is None or reached[1].name == "__init__":
            return
        index, function = reached
        if function in self._visited and self._visited[function] >= is_certain:
            return
        self._visited[function] = is_certain
        arguments = function.args
        names = [*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs]
        self._body(index, function, {a.arg: UNKNOWN for a in names}, is_certain=is_certain)

    def _body(
        self, index: int, function: Function, local: Environment, *, is_certain: bool
    ) -> None:
        source = self._lineage.classes[index]
        scope = scope_of(function, source.module, local)
        for statement in function.body:
            self._node(statement, index, source, scope, is_certain=is_certain)

    def _node(
        self, node: ast.AST, index: int, source: ClassSource, scope: Scope, *, is_certain: bool
    ) -> None:
        kept: tuple[ast.AST, ...] = ()
        if isinstance(node, ast.Call):
            kept = self._call(node, index, source, scope, is_certain=is_certain)
        elif isinstance(node, ast.Attribute) and scope.is_self(node.value):
            self._use(node.attr)
            return
        elif scope.is_self(node) and not source.is_of_library:
            self._give_up()  # `self` is handed to something that may register more
        is_certain = is_certain and not isinstance(node, _BRANCHES)
        for child in ast.iter_child_nodes(node):
            if child not in kept:
                self._node(child, index, source, scope, is_certain=is_certain)

    def _call(
        self, call: ast.Call, index: int, source: ClassSource, scope: Scope, *, is_certain: bool
    ) -> tuple[ast.AST, ...]:
        """Take note of a call; returns the children that need no further look."""
        match call.func:
            case ast.Attribute(value=value, attr=name) if scope.is_self(value):
                self._own_call(name, call, source, scope, is_certain=is_certain)
                return (call.func,)
            case ast.Attribute(value=ast.Call(func=ast.Name(id="super")), attr=name):
                self._super_call(name, index, call, scope, is_certain=is_certain)
                return (call.func,)
            case ast.Attribute(attr="__init__"):
                self._explicit_base(index, call, scope)
                return tuple(call.args[:1])
            case ast.Name(id=name) if name in _SURVIVES_SELF:
                return tuple(call.args)
        return ()

    def _own_call(
        self, name: str, call: ast.Call, source: ClassSource, scope: Scope, *, is_certain: bool
    ) -> None:
        registered = register_call(name, call, scope, self._library)
        if registered is not None:
            self._register(registered, call, source, is_certain=is_certain)
        elif name in ("declare_parameter", "declare_parameters"):
            self._declare(name, call, scope, is_certain=is_certain)
        else:
            self.method(name, 0, is_certain=is_certain)

    def _register(
        self,
        registered: CodeComponent | str,
        call: ast.Call,
        source: ClassSource,
        *,
        is_certain: bool,
    ) -> None:
        if isinstance(registered, str):
            self.found.knows_components = False
            return
        known = self.found.components.get(call)
        certain = is_certain and registered.is_required
        if known is None or certain:
            self.found.components[call] = replace(
                registered, is_required=certain, is_of_library=source.is_of_library
            )
        if not registered.is_named_in_full:
            self.found.knows_components = False
        if registered.ros_parameter:
            name = registered.ros_parameter
            parameter = CodeParameter(name=name, kind=None, span=registered.span)
            self.found.parameters.setdefault(name, parameter)

    def _declare(self, method: str, call: ast.Call, scope: Scope, *, is_certain: bool) -> None:
        declared = declared_parameters(method, call, scope, self._library)
        if declared is None:
            self.found.knows_parameters = False
        for parameter in declared or ():
            if is_certain:
                self.found.parameters[parameter.name] = parameter
            else:
                # Another branch may declare it of another kind.
                of_any_kind = replace(parameter, kind=None)
                self.found.parameters.setdefault(parameter.name, of_any_kind)

    def _super_call(
        self, name: str, index: int, call: ast.Call, scope: Scope, *, is_certain: bool
    ) -> None:
        if any(keyword.arg in _DECLARES_ALL for keyword in call.keywords):
            self.found.knows_parameters = False
        if name == "__init__":
            self.constructor(index + 1, (call, scope))
        else:
            self.method(name, index + 1, is_certain=is_certain)

    def _explicit_base(self, index: int, call: ast.Call, scope: Scope) -> None:
        """`Base.__init__(self, ...)`: sound where one base follows another."""
        without_self = ast.Call(func=call.func, args=call.args[1:], keywords=call.keywords)
        self.constructor(index + 1, (without_self, scope))

    def _use(self, name: str) -> None:
        """`self.name` that is not called here: a callback, or a method that someone calls."""
        if name.startswith("register_obk_"):
            self.found.knows_components = False
        elif name.startswith("declare_parameter"):
            self.found.knows_parameters = False
        else:
            self.method(name, 0, is_certain=False)

    def _give_up(self) -> None:
        self.found.knows_components = False
        self.found.knows_parameters = False
