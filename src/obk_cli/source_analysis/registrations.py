"""Find what a node's class registers and declares, by following its constructors up its bases.

The search follows `super().__init__` with the values of its arguments, and methods of `self` that
are used on the way. Values computed at run time count as unknown.
"""

import ast
from dataclasses import dataclass, field, replace
from typing import Final

from obelisk_spec.registration import (
    EXPECTED,
    ArgumentKind,
    RegistrationArgumentError,
    bind_registration,
    is_required_by_default,
)
from obk_cli.config.environment import CodeComponent, CodeParameter
from obk_cli.config.model import ComponentKind
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import Span
from obk_cli.source_analysis.base_calls import has_no_way_to_base
from obk_cli.source_analysis.callbacks import check_arguments
from obk_cli.source_analysis.class_hierarchy import ClassSource, Function, Lineage
from obk_cli.source_analysis.declared_parameters import DECLARING, declared_parameters
from obk_cli.source_analysis.live_parameters import class_parameters
from obk_cli.source_analysis.modules import (
    UNKNOWN,
    Dotted,
    KnownValues,
    Module,
    ModuleLibrary,
    Value,
    dotted_name,
    message_type,
    span_of,
    value_of,
)
from obk_cli.source_analysis.scope import Scope, bound_arguments, mentions, scope_of

__all__ = ["registrations_of"]

_KINDS: Final[dict[str, ComponentKind]] = {
    "register_obk_publisher": "publisher",
    "register_obk_subscription": "subscriber",
    "register_obk_timer": "timer",
}
"""Method -> kind of component that it registers."""


@dataclass(frozen=True, slots=True)
class RegisterCall:
    """A registration."""

    component: CodeComponent
    callback: ast.expr | None


@dataclass(frozen=True, slots=True)
class InvalidCall:
    """A registration that raises an exception."""

    reason: str


def register_call(
    name: str, call: ast.Call, scope: Scope, library: ModuleLibrary
) -> RegisterCall | InvalidCall | str | None:
    """What a call registers; a string says why that is unknown; None: no registration."""
    if name not in _KINDS:
        return None
    if any(isinstance(a, ast.Starred) for a in call.args) or any(
        k.arg is None for k in call.keywords
    ):
        return "its arguments are computed"

    def value(expression: ast.expr | None) -> Value:
        return value_of(expression, scope.module, library, scope.local)

    named = {k.arg: k.value for k in call.keywords if k.arg}
    try:
        given = bind_registration(name, call.args, named, lambda one: _described(value(one)))
    except RegistrationArgumentError as error:
        return InvalidCall(str(error))
    if isinstance(value(given.get("msg_type")), str):
        return InvalidCall(f"`msg_type` is a string, expected {EXPECTED['msg_type']}")
    if "callback" not in given and _KINDS[name] != "publisher":
        return InvalidCall(f"it has no `callback`, expected {EXPECTED['callback']}")
    ros_parameter, key = value(given.get("ros_parameter")), value(given.get("key"))
    names = [ros_parameter, key]
    if not any(isinstance(text, str) for text in names):
        return "its names are computed"
    msg_type, has_default = value(given.get("msg_type")), value(given.get("default")) is not None
    required = (
        value(given["required"])
        if "required" in given
        else is_required_by_default(_text(ros_parameter))
    )
    component = CodeComponent(
        kind=_KINDS[name],
        ros_parameter=_text(ros_parameter),
        key=_text(key),
        msg_type=message_type(msg_type),
        has_type=msg_type is not None,
        is_required=required is True and not has_default,
        is_optional=required is False,
        has_default=has_default,
        is_named_in_full=UNKNOWN not in names,
        is_of_library=False,
        span=span_of(call, scope.module.source),
    )
    return RegisterCall(component, given.get("callback"))


def _described(value: Value) -> str | ArgumentKind:
    match value:
        case str() as text:
            return text
        case Dotted():
            return ArgumentKind.CLASS
        case bool():
            return ArgumentKind.TRUTH_VALUE
        case None:
            return ArgumentKind.NOTHING
    return ArgumentKind.UNKNOWN


def _text(value: Value) -> str | None:
    return value if isinstance(value, str) else None


_SURVIVES_SELF: Final = {"super", "isinstance", "type", "id", "print", "repr", "str", "hasattr"}
_DECLARES_ALL: Final = (
    "allow_undeclared_parameters",
    "automatically_declare_parameters_from_overrides",
)
_BRANCHES = (ast.If, ast.For, ast.AsyncFor, ast.While, ast.Try, ast.IfExp, ast.Match, ast.Lambda,
             ast.FunctionDef, ast.AsyncFunctionDef, ast.ListComp, ast.SetComp, ast.DictComp,
             ast.GeneratorExp, ast.BoolOp)  # fmt: skip
_LEAVES = (ast.expr_context, ast.operator, ast.cmpop, ast.unaryop, ast.boolop, ast.Constant)
"""Most syntax nodes: they contain no names."""


@dataclass(slots=True)
class Registrations:
    """Everything that was found; the two `knows_` are False if something is unknown."""

    components: dict[tuple[ast.Call, ...], CodeComponent] = field(default_factory=dict)
    """By the call, preceded by the calls of helper methods that lead to it."""
    callbacks: dict[ast.Call, tuple[ast.Attribute, Module]] = field(default_factory=dict)
    """Callbacks that are attributes of the node."""
    invalid: dict[ast.Call, Diagnostic] = field(default_factory=dict)
    """The errors of calls that certainly raise an exception."""
    without_base: tuple[Function, ClassSource] | None = None
    """The constructor that does not call its base classes' constructors."""
    parameters: dict[str, CodeParameter] = field(default_factory=dict)
    knows_components: bool = True
    knows_parameters: bool = True


def registrations_of(
    lineage: Lineage, library: ModuleLibrary, *, has_arguments: bool
) -> Registrations:
    """The components and parameters of a class; uses its defaults unless `has_arguments`."""
    walk = _Walk(lineage, library, has_arguments=has_arguments)
    declared, walk.found.knows_parameters = class_parameters(lineage, library)
    walk.found.parameters.update(declared)
    walk.constructor(0, None)
    for name in sorted({m.name for c in lineage.classes for m in c.methods()}):
        if name.startswith("on_"):
            walk.method(name, 0, is_certain=name == "on_configure")
    if walk.reaches_library or not lineage.is_whole:
        walk.found.without_base = None
    walk.found.knows_components &= lineage.is_whole
    walk.found.knows_parameters &= lineage.is_whole
    return walk.found


def _may_return(node: ast.AST) -> bool:
    """Whether a statement may end the function that contains it, other than by an exception."""
    if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.expr):
        return False
    return isinstance(node, ast.Return) or any(map(_may_return, ast.iter_child_nodes(node)))


_MOST_HELPER_CALLS: Final = 1_000
"""Maximum number of calls of helper methods followed with their arguments."""


def _takes_names(function: Function) -> bool:
    """Whether a method registers or declares what its arguments name."""
    is_plain = function.name != "__init__" and not function.decorator_list
    return is_plain and mentions(function, "register_obk_", "declare_parameter")


def _is_super(node: ast.Attribute) -> bool:
    """Whether an attribute is one of `super()`."""
    match node.value:
        case ast.Call(func=ast.Name(id="super")):
            return True
    return False


class _Walk:
    def __init__(self, lineage: Lineage, library: ModuleLibrary, *, has_arguments: bool) -> None:
        self._has_arguments = has_arguments
        self.found = Registrations()
        self._lineage = lineage
        self._library = library
        self._visited: dict[Function, bool] = {}
        self._calls: tuple[ast.Call, ...] = ()
        self._helpers: dict[Function, bool] = {}
        self._helper_calls = 0
        self._origin: tuple[ClassSource, Scope] | None = None
        """The class and the scope of the outermost call of a method that is followed."""
        self._base_calls: tuple[tuple[ast.Call, Scope], ...] = ()
        """The `super().__init__` of the user's classes that are being followed."""
        self._certain: dict[tuple[ast.Call, ...], CodeComponent] = {}
        self.reaches_library = False

    def constructor(self, start: int, call: tuple[ast.Call, Scope] | None) -> None:
        """Follow the first constructor from `start` on, with the arguments of `call`."""
        reached = self._lineage.method("__init__", start)
        if reached is None:
            return
        index, function = reached
        source = self._lineage.classes[index]
        is_open = call is None and self._has_arguments
        local = bound_arguments(function, source.module, call, self._library, is_open=is_open)
        self._body(index, function, local, is_certain=True)
        self.reaches_library |= source.is_of_library
        if not mentions(function, "__init__"):
            self._give_up()
            if not source.is_of_library and has_no_way_to_base(function, self._lineage):
                self.found.without_base = (function, source)

    def helper(
        self, name: str, start: int, call: ast.Call, scope: Scope, *, is_certain: bool
    ) -> None:
        """Follow a method of the node that is called here, with its arguments if it registers."""
        reached = self._lineage.method(name, start)
        if reached is None:
            return
        index, function = reached
        if function not in self._helpers:
            self._helpers[function] = _takes_names(function)
        if not self._helpers[function]:
            self.method(name, start, is_certain=is_certain)
            return
        self._helper_calls += 1
        if call in self._calls or self._helper_calls > _MOST_HELPER_CALLS:
            self._give_up()
            return
        module = self._lineage.classes[index].module
        local = bound_arguments(function, module, (call, scope), self._library, is_open=False)
        self._calls = (*self._calls, call)
        self._body(index, function, local, is_certain=is_certain)
        self._calls = self._calls[:-1]

    def method(self, name: str, start: int, *, is_certain: bool) -> None:
        """Follow a method of the node, whatever its arguments."""
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
        self, index: int, function: Function, local: KnownValues, *, is_certain: bool
    ) -> None:
        source = self._lineage.classes[index]
        scope = scope_of(function, source.module, self._library, local)
        for statement in function.body:
            self._node(statement, index, source, scope, is_certain=is_certain)
            is_certain = is_certain and not _may_return(statement)

    def _node(
        self, node: ast.AST, index: int, source: ClassSource, scope: Scope, *, is_certain: bool
    ) -> None:
        kept: tuple[ast.AST, ...] = ()
        if isinstance(node, ast.Call):
            kept = self._call(node, index, source, scope, is_certain=is_certain)
        elif isinstance(node, ast.Attribute) and (scope.is_self(node.value) or _is_super(node)):
            self._use(node.attr)
            return
        elif scope.is_self(node) and not source.is_of_library:
            self._give_up()  # `self` is passed to code that may register more
        is_certain = is_certain and not isinstance(node, _BRANCHES)
        for child in ast.iter_child_nodes(node):
            if child not in kept and not isinstance(child, _LEAVES):
                self._node(child, index, source, scope, is_certain=is_certain)

    def _call(
        self, call: ast.Call, index: int, source: ClassSource, scope: Scope, *, is_certain: bool
    ) -> tuple[ast.AST, ...]:
        """Process a call; return the children that still need processing."""
        match call.func:
            case ast.Attribute(value=value, attr=name) if scope.is_self(value):
                self._own_call(name, 0, call, source, scope, is_certain=is_certain)
                return (call.func,)
            case ast.Attribute(value=ast.Call(func=ast.Name(id="super")), attr=name):
                self._super_call(name, index, call, source, scope, is_certain=is_certain)
                return (call.func,)
            case ast.Attribute(attr="__init__"):
                self._explicit_base(index, call, scope)
                return tuple(call.args[:1])
            case ast.Name(id=name) if name in _SURVIVES_SELF:
                return tuple(call.args)
        return ()

    def _own_call(
        self,
        name: str,
        start: int,
        call: ast.Call,
        source: ClassSource,
        scope: Scope,
        *,
        is_certain: bool,
    ) -> None:
        reached = self._lineage.method(name, start)
        is_overridden = reached and not self._lineage.classes[reached[0]].is_of_library
        registered = None if is_overridden else register_call(name, call, scope, self._library)
        if registered is not None:
            self._register(registered, call, source, scope, is_certain=is_certain)
        elif name in DECLARING and not is_overridden:
            self._declare(name, call, scope, is_certain=is_certain)
        else:
            before, self._origin = self._origin, self._origin or (source, scope)
            self.helper(name, start, call, scope, is_certain=is_certain)
            self._origin = before

    def _register(
        self,
        registered: RegisterCall | InvalidCall | str,
        call: ast.Call,
        source: ClassSource,
        scope: Scope,
        *,
        is_certain: bool,
    ) -> None:
        if isinstance(registered, InvalidCall) and is_certain:
            span = span_of(call, scope.module.source)
            method = call.func.attr if isinstance(call.func, ast.Attribute) else ""
            self.found.invalid[call] = found("OBK427", f"`{method}`: {registered.reason}", span)
        if not isinstance(registered, RegisterCall):
            self.found.knows_components = False
            return
        match registered.callback:
            case ast.Attribute(value=value) as callback if scope.is_self(value):
                self.found.callbacks[call] = (callback, source.module)
        component = registered.component
        place = (*self._calls, call)
        earlier = self._earlier(component, place) if is_certain else None
        if earlier is not None:
            self.found.invalid[call] = found(
                "OBK427",
                f"the {component.kind} `{component.name}` is already registered",
                component.span,
                help="give it another name, or remove one of the two calls",
                related=(Related(message="registered here", span=earlier.span),),
            )
            return
        certain = is_certain and component.is_required
        if place not in self.found.components or certain:
            first, first_scope = self._origin or (source, scope)
            types = [v for name, v in first_scope.local.items() if name.endswith("_msg_type")]
            self.found.components[place] = replace(
                component,
                is_required=certain,
                is_of_library=first.is_of_library,
                given_type=self._given_type(component) if source.is_of_library else None,
                has_typed_base=first.is_of_library and any(v is not None for v in types),
                wrong_callback=check_arguments(
                    registered.callback, component, scope, self._lineage
                ),
            )
        if not component.is_named_in_full:
            self.found.knows_components = False
        if component.ros_parameter:
            name = component.ros_parameter
            parameter = CodeParameter(name=name, kind=None, span=component.span)
            self.found.parameters.setdefault(name, parameter)

    def _given_type(self, component: CodeComponent) -> Span | None:
        """Where a user's class passes the type of a component to its base class."""
        for call, scope in self._base_calls if component.msg_type else ():
            for argument in (*call.args, *(keyword.value for keyword in call.keywords)):
                value = value_of(argument, scope.module, self._library, scope.local)
                if message_type(value) == component.msg_type:
                    return span_of(argument, scope.module.source)
        return None

    def _earlier(
        self, component: CodeComponent, place: tuple[ast.Call, ...]
    ) -> CodeComponent | None:
        """A registration of the same component that certainly runs, by another call."""
        same = (
            other
            for other_place, other in self._certain.items()
            if other_place != place
            and other.kind == component.kind
            and not component.names.isdisjoint(other.names)
        )
        earlier = next(same, None)
        if earlier is None:
            self._certain[place] = component
        return earlier

    def _declare(self, method: str, call: ast.Call, scope: Scope, *, is_certain: bool) -> None:
        declared = declared_parameters(method, call, scope, self._library)
        if declared is None:
            self.found.knows_parameters = False
        for parameter in declared or ():
            if is_certain:
                self.found.parameters[parameter.name] = parameter
            else:
                # Another branch may declare it with another type.
                of_any_kind = replace(parameter, kind=None)
                self.found.parameters.setdefault(parameter.name, of_any_kind)

    def _super_call(
        self,
        name: str,
        index: int,
        call: ast.Call,
        source: ClassSource,
        scope: Scope,
        *,
        is_certain: bool,
    ) -> None:
        if any(keyword.arg in _DECLARES_ALL for keyword in call.keywords):
            self.found.knows_parameters = False
        if name == "__init__":
            before = self._base_calls
            self._base_calls += () if source.is_of_library else ((call, scope),)
            self.constructor(index + 1, (call, scope))
            self._base_calls = before
        elif name in _KINDS or name in DECLARING:
            self._own_call(name, index + 1, call, source, scope, is_certain=is_certain)
        else:
            self.method(name, index + 1, is_certain=is_certain)

    def _explicit_base(self, index: int, call: ast.Call, scope: Scope) -> None:
        """Follow `Base.__init__(self, ...)`; an unknown base counts as the next one."""
        base = call.func.value if isinstance(call.func, ast.Attribute) else call.func
        definition = self._library.definition(dotted_name(base, scope.module) or "")
        named = (
            place
            for place, source in enumerate(self._lineage.classes)
            if definition is not None and source.node is definition.node
        )
        without_self = ast.Call(func=call.func, args=call.args[1:], keywords=call.keywords)
        self.constructor(next(named, index + 1), (without_self, scope))

    def _use(self, name: str) -> None:
        """Follow `self.name` that is not called here: a callback, or a method called elsewhere."""
        if name.startswith("register_obk_"):
            self.found.knows_components = False
        elif name.startswith("declare_parameter"):
            self.found.knows_parameters = False
        else:
            self.method(name, 0, is_certain=False)

    def _give_up(self) -> None:
        self.found.knows_components = False
        self.found.knows_parameters = False
