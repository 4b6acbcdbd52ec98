"""OBK405 to OBK410, OBK412, OBK415, OBK420 to OBK429: compare Python nodes with their config."""

from collections.abc import Iterator, Sequence
from difflib import SequenceMatcher

from obelisk_spec.components import SETTINGS_PARAMETER, component_identity, component_spellings
from obelisk_spec.names import resolve_msg_type
from obelisk_spec.runtime_protocol import USE_SIM_TIME
from obelisk_spec.suggestions import (
    ask_for,
    list_names,
    near_names,
    sure_name,
    there_is,
    with_article,
)
from obk_cli.check.context import CheckContext
from obk_cli.config.environment import (
    CodeComponent,
    CodeFault,
    CodeParameter,
    KeyUse,
    NodeFacts,
    SourceFaults,
    kind_of_value,
)
from obk_cli.config.fixes import append_to
from obk_cli.config.model import PARAMS_PACKAGE, Component, ConfigParameter, Node, Spanned
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.edits import Edit

__all__ = ["check_code"]

_OF_EVERY_NODE = (USE_SIM_TIME, "start_type_description_service")
"""Parameters that rclpy itself declares."""
_PREFIXES_OF_EVERY_NODE = ("qos_overrides.", "diagnostic_updater.")


def check_code(context: CheckContext) -> Iterator[Diagnostic]:
    """Compare every node whose source can be read with its source."""
    read: set[tuple[str, str]] = set()
    seen: set[tuple[str, str]] = set()
    for node in context.stack.nodes:
        if node.pkg is None or node.executable is None:
            continue
        command = (node.pkg.value, node.executable.value)
        code = context.environment.read_node_code(*command)
        if code is None:
            continue
        if not isinstance(code, SourceFaults) and command not in read:
            read.add(command)
            yield from _check_class(code, node.executable)
        findings = () if isinstance(code, CodeFault) else code.findings
        if isinstance(code, NodeFacts):
            yield from _check_components(node, node.executable, code)
            yield from _check_parameters(node, code)
            findings += (*_check_keys(node, code), *_wrong_callbacks(node, code))
        for finding in findings:
            # Two nodes may import one module, and a node's path may lead to any package.
            cause = (finding.code, finding.message)
            is_elsewhere = finding.code == "OBK421" and "PYTHONPATH" in dict(node.env)
            if cause not in seen and not is_elsewhere:
                seen.add(cause)
                yield finding


def _check_class(code: NodeFacts | CodeFault, executable: Spanned[str]) -> Iterator[Diagnostic]:
    """Report why the node cannot be created, once per executable."""
    if isinstance(code, CodeFault):
        related = (Related(message="in the source", span=code.span),) if code.span else ()
        yield found(
            "OBK410",
            f"`{executable.value}` cannot start: `{code.place}` {code.message}",
            executable.span,
            help=code.help,
            related=related,
        )
    elif code.missing_methods:
        near = next((m for m in code.missing_methods if m.near), None)
        yield found(
            "OBK408",
            f"class `{code.class_name}` does not implement "
            f"{list_names(m.name for m in code.missing_methods)}, so it cannot be instantiated",
            executable.span,
            help=f"if `{near.near[0]}` is meant to implement it, rename it to `{near.name}`"
            if near
            else None,
            related=(
                Related(message="the class", span=code.span),
                *(
                    Related(message=f"`{m.name}` is declared here", span=m.span)
                    for m in code.missing_methods
                ),
            ),
        )


def _check_components(
    node: Node, executable: Spanned[str], code: NodeFacts
) -> Iterator[Diagnostic]:
    matched, only_config, only_code = _matched(node, code)
    of_hardware = [c for c in only_config if c.is_unused]
    if of_hardware and node.runs_simulation:
        only_config = [c for c in only_config if not c.is_unused]
        yield _of_hardware(of_hardware, node)
    has_settings = any(p.name == SETTINGS_PARAMETER for p in node.params)
    for component, registered in matched:
        yield from _check_type(component, registered, code)
        if not has_settings:
            yield from _check_has_type(component, registered, code)
    unmatched = {c.kind for c in only_config}
    if not code.knows_components:
        only_config = []
    for component in only_config:
        of_other_kind = (r for r in only_code if component.identity in r.names)
        meant = next(of_other_kind, None) or _nearest(component, only_code)
        if meant is not None:
            only_code.remove(meant)
        yield _not_registered(component, meant, code)
    if has_settings:
        return
    nameless = {c.kind for c in node.components if c.identity is None}
    for registered in only_code:
        # An entry with any name may be the one whose key the code computes.
        is_known = registered.is_named_in_full or (
            registered.ros_parameter is not None and registered.kind not in unmatched
        )
        if is_known and registered.kind not in nameless:
            yield from _not_configured(registered, node, executable, code)


def _matched(
    node: Node, code: NodeFacts
) -> tuple[list[tuple[Component, CodeComponent]], list[Component], list[CodeComponent]]:
    """Components that both sides have, those of the config only, and those of the code only."""
    by_parameter = {parameter.name for parameter in node.params}
    pairs: list[tuple[Component, CodeComponent]] = []
    only_config: list[Component] = []
    for component in node.components:
        registered = code.component_of(component)
        if registered is not None:
            pairs.append((component, registered))
        elif component.name is not None:
            only_config.append(component)
    known = [registered for _, registered in pairs]
    only_code = [
        r for r in code.components if r not in known and r.ros_parameter not in by_parameter
    ]
    return pairs, only_config, only_code


def _nearest(component: Component, candidates: Sequence[CodeComponent]) -> CodeComponent | None:
    """The code's component that the config's component most likely refers to."""
    same_kind = [c for c in candidates if c.kind == component.kind]
    name = component.identity or ""

    def likeness(candidate: CodeComponent) -> float:
        return max(SequenceMatcher(None, name, other).ratio() for other in candidate.names)

    return max(same_kind, key=likeness, default=None)


def _of_hardware(components: Sequence[Component], node: Node) -> Diagnostic:
    names = [component.name for component in components if component.name is not None]
    return found(
        "OBK406",
        f"the simulator `{node.node_name}` ignores {list_names(name.value for name in names)}",
        names[0].span,
        severity="info",
        help="keep it if the hardware uses it",
        related=(Related(message="ignored too", span=name.span) for name in names[1:]),
    )


def _not_registered(
    component: Component, meant: CodeComponent | None, code: NodeFacts
) -> Diagnostic:
    assert component.name is not None  # components without a name are not compared
    name = component.name
    elsewhere = next((r for r in code.components if name.value in r.names), None)
    if meant is not None and meant.kind == component.kind:
        help = (
            ask_for((meant.name,))
            if near_names(name.value, meant.names)
            else f"the code registers `{meant.name}`, which is not configured"
        )
    elif elsewhere is not None:
        help = f"the code registers it as a {elsewhere.kind}"
    else:
        same = [r.name for r in code.components if r.kind == component.kind]
        help = (
            f"it registers {list_names(same)}"
            if same
            else f"it does not register a {component.kind}"
        )
    shown = meant or elsewhere
    return found(
        "OBK406",
        f"class `{code.class_name}` does not register the {component.kind} `{name.value}`",
        name.span,
        help=help,
        related=(_registration_of(shown),)
        if shown
        else (Related(message="the class", span=code.span),),
    )


def _not_configured(
    registered: CodeComponent, node: Node, executable: Spanned[str], code: NodeFacts
) -> Iterator[Diagnostic]:
    if registered.has_default:
        return
    rest = "timer_period_sec: ..." if registered.kind == "timer" else "topic: ..."
    line = f"{{{': '.join(registered.written)}, {rest}}}"
    if registered.is_required:
        # Nodes of API generation 3 run without it; only their configs omit all `ros_parameter`s.
        goes_on = registered.has_typed_base and not any(c.ros_parameter for c in node.components)
        yield found(
            "OBK405",
            f"class `{code.class_name}` registers the {registered.kind} `{registered.name}`, "
            f"which `{node.node_name}` does not configure",
            executable.span,
            severity="warning" if goes_on else None,
            help=f"add `{line}` to its `{registered.kind}s`",
            related=(_registration_of(registered),),
        )
    elif registered.is_optional and not registered.is_of_library:
        yield found(
            "OBK405",
            f"class `{code.class_name}` registers the optional {registered.kind} "
            f"`{registered.name}`, which `{node.node_name}` leaves out",
            executable.span,
            severity="info",
            help=f"to use it, add `{line}` to its `{registered.kind}s`",
            related=(_registration_of(registered),),
        )


def _check_type(
    component: Component, registered: CodeComponent, code: NodeFacts
) -> Iterator[Diagnostic]:
    if component.msg_type is None or registered.msg_type is None:
        return
    written = resolve_msg_type(component.msg_type.value)
    if written is not None and written != registered.msg_type:
        here = with_article(component.msg_type.value)
        in_code = with_article(registered.msg_type.replace("/msg/", "/"))
        in_config = f"write `{_shortest(registered.msg_type)}`"
        is_of_user = registered.given_type is not None or not registered.is_of_library
        place = registered.given_type
        yield found(
            "OBK407",
            f"{component.kind} `{component.identity}` is {here} here and {in_code} in class "
            f"`{code.class_name}`",
            component.msg_type.span,
            help=f"{in_config} here, or `{_shortest(written)}` in the class"
            if is_of_user
            else f"{in_config}, or remove `msg_type`",
            related=(
                Related(message="the class passes its type here", span=place)
                if place is not None
                else _registration_of(registered),
            ),
        )


def _check_has_type(
    component: Component, registered: CodeComponent, code: NodeFacts
) -> Iterator[Diagnostic]:
    if component.kind == "timer" or component.msg_type or component.tree.get("msg_type"):
        return
    if registered.has_type or registered.has_default:
        return
    yield found(
        "OBK425",
        f"{component.kind} `{component.identity}` has no `msg_type`, either here or in class "
        f"`{code.class_name}`",
        component.name.span if component.name else component.span,
        help="add `msg_type: ...`",
        related=(_registration_of(registered),),
    )


def _check_keys(node: Node, code: NodeFacts) -> Iterator[Diagnostic]:
    """Report keys that match no component of the node, unless a component may have any name."""
    if not code.knows_components or any(p.name == SETTINGS_PARAMETER for p in node.params):
        return
    # A component of the config that the code does not register has a finding of its own.
    in_config = {
        (c.kind, spelling)
        for c in node.components
        for name in (c.ros_parameter, c.key)
        if name
        for spelling in component_spellings(name.value)
    }
    for use in code.key_uses:
        known = [c for c in code.components if c.kind == use.kind]
        is_known = any(use.key in c.names for c in known) or (use.kind, use.key) in in_config
        if not is_known:
            yield _unknown_key(use, code, [component_identity(c.key or c.name) for c in known])


def _unknown_key(use: KeyUse, code: NodeFacts, known: Sequence[str]) -> Diagnostic:
    other = next((c.kind for c in code.components if use.key in c.names), None)
    near = ask_for(near_names(use.key, known))
    registers = (
        f"it registers {list_names(known)}" if known else f"it does not register a {use.kind}"
    )
    return found(
        "OBK423",
        f"class `{code.class_name}` does not register the {use.kind} `{use.key}`",
        use.span,
        help=f"the code registers it as a {other}" if other else near or registers,
        related=(Related(message="the class", span=code.span),),
    )


def _wrong_callbacks(node: Node, code: NodeFacts) -> Iterator[Diagnostic]:
    """The findings in callbacks of components that the node creates."""
    configured = [code.component_of(component) for component in node.components]
    for registered in code.components:
        is_created = registered.has_default or registered in configured
        if is_created and registered.wrong_callback is not None:
            yield registered.wrong_callback


def _shortest(msg_type: str) -> str:
    """The bare name if it identifies the type, otherwise package and name."""
    bare = msg_type.rpartition("/")[2]
    return bare if resolve_msg_type(bare) == msg_type else msg_type.replace("/msg/", "/")


def _check_parameters(node: Node, code: NodeFacts) -> Iterator[Diagnostic]:
    by_name = {declared.name: declared for declared in code.parameters}
    unset = [name for name in by_name if name not in {p.name for p in node.params}]
    for parameter in node.params:
        declared = by_name.get(parameter.name)
        if declared is not None:
            yield from _check_kind(parameter, declared, code)
        elif parameter.name in (*_OF_EVERY_NODE, PARAMS_PACKAGE) or parameter.name.startswith(
            _PREFIXES_OF_EVERY_NODE
        ):
            continue
        elif code.knows_parameters:
            yield _undeclared(parameter, code)
        elif (meant := sure_name(parameter.name, unset)) is not None:
            yield _similar(parameter, by_name[meant], code)


def _check_kind(
    parameter: ConfigParameter, declared: CodeParameter, code: NodeFacts
) -> Iterator[Diagnostic]:
    written = kind_of_value(parameter.value)
    if written is None or declared.kind is None:
        return
    is_taken = declared.notes is not None and written == declared.kind.replace("float", "int")
    if declared.kind == written or is_taken:
        yield from _check_limits(parameter, declared, code)
        return
    help: str | None = None
    fix: tuple[Edit, ...] = ()
    if written == "int" and declared.kind == "float":
        whole = str(parameter.value)
        help, fix = f"write `{whole}.0`", append_to(parameter.span, whole, ".0")
    elif written == "list of ints" and declared.kind == "list of floats":
        help = "write the numbers with a decimal point"
    yield found(
        "OBK412",
        f"parameter `{parameter.name}` is {with_article(written)} here and "
        f"{with_article(declared.kind)} in class `{code.class_name}`",
        parameter.span,
        help=help,
        related=(Related(message="in the code", span=declared.span),),
        fix=fix,
    )


def _check_limits(
    parameter: ConfigParameter, declared: CodeParameter, code: NodeFacts
) -> Iterator[Diagnostic]:
    fault = None if declared.notes is None else declared.notes.fault(parameter.value)
    if fault is None:
        return
    sentence, _, hint = fault.partition("; ")
    yield found(
        "OBK415",
        f"parameter `{parameter.name}` of class `{code.class_name}` {sentence}",
        parameter.span,
        help=hint or None,
        related=(Related(message="in the code", span=declared.span),),
    )


def _similar(parameter: ConfigParameter, declared: CodeParameter, code: NodeFacts) -> Diagnostic:
    """A likely typo, for code that computes parameter names and may declare the written one."""
    return found(
        "OBK409",
        f"parameter `{parameter.name}` may be a typo: class `{code.class_name}` declares "
        f"`{declared.name}`, which is not set",
        parameter.key_span or parameter.span,
        help=ask_for((declared.name,)),
        related=(Related(message="in the code", span=declared.span),),
    )


def _undeclared(parameter: ConfigParameter, code: NodeFacts) -> Diagnostic:
    settings = {s for c in code.components for s in (c.ros_parameter,) if s}
    own = [
        declared.name
        for declared in code.parameters
        if declared.name not in settings
        and declared.name not in ("params_path", SETTINGS_PARAMETER)
    ]
    near = ask_for(near_names(parameter.name, own))
    return found(
        "OBK409",
        f"class `{code.class_name}` does not declare the parameter `{parameter.name}`",
        parameter.key_span or parameter.span,
        severity="warning" if near else "info",
        help=near or there_is(own) or "it does not declare any parameters",
        related=(Related(message="the class", span=code.span),),
    )


def _registration_of(component: CodeComponent) -> Related:
    name = f"`{component.name}`" if component.name else f"the {component.kind}"
    return Related(message=f"{name} is registered here", span=component.span)
