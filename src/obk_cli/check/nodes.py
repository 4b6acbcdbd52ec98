"""OBK107, OBK108, OBK201, OBK202, OBK207, OBK208: which nodes exist, and their components."""

from collections.abc import Collection, Iterator
from dataclasses import replace

from obelisk_spec.components import (
    CALLBACK_GROUPS_PARAMETER,
    SETTING_SUFFIX,
    SETTINGS_PARAMETER,
    component_identity,
    standard_component,
)
from obelisk_spec.suggestions import did_you_mean, near_names, sure_name
from obk_cli.check.context import CheckContext, code_of
from obk_cli.config.environment import NodeFacts
from obk_cli.config.fixes import respell
from obk_cli.config.model import Component, Node, Spanned, Stack
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import Span

__all__ = [
    "check_callback_groups",
    "check_components",
    "check_node_names",
    "check_required_sections",
]

_USUAL = ("control", "estimation", "robot")


def check_required_sections(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that each section of the usual loop has a node, on any device."""
    stack = context.stack
    empty = [section for section in _USUAL if next(stack.section(section), None) is None]
    if not stack.nodes and not any(joystick.on for joystick in stack.joysticks):
        help = "a stack usually has a controller, an estimator and a robot"
        yield found("OBK201", "the stack has no node", stack.span, severity="error", help=help)
    elif empty:
        message = f"the stack has no node in {' or '.join(f'`{section}`' for section in empty)}"
        yield found("OBK201", message, stack.span)


def check_node_names(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that no two nodes have the same full name."""
    seen: dict[str, Span] = {}
    for name, place, help in _named(context.stack):
        if name not in seen:
            seen[name] = place
            continue
        yield found(
            "OBK202",
            f"two nodes are named `{name}`",
            place,
            help=help,
            related=(Related(message="the other one", span=seen[name]),),
        )


def _named(stack: Stack) -> Iterator[tuple[str, Span, str]]:
    """Each node's full name, its location, and a hint on how to change the name."""
    for node in stack.nodes:
        named = node.name or node.pkg
        place = named.span if named else node.span
        yield node.full_name, place, "change the `name` or `namespace` of one of them"
    for joystick in stack.joysticks:
        if joystick.on:
            yield joystick.full_name, joystick.span, "switch one of them off with `on: false`"


_MOST_SUGGESTIONS = 200
"""Maximum number of findings for which similar names are searched."""


def check_components(context: CheckContext) -> Iterator[Diagnostic]:
    """Report duplicate entries for one component, and names that contradict each other."""
    for node in context.stack.nodes:
        yield from _check_twice(node)
        yield from _check_replaced(node)
        if any(component.ros_parameter and component.key for component in node.components):
            yield from _check_contradictions(node, code_of(node, context.environment))


def _check_twice(node: Node) -> Iterator[Diagnostic]:
    seen: dict[tuple[str, str], Component] = {}
    for component in node.components:
        if component.identity is None or component.name is None:
            continue
        same = (component.kind, component.identity)
        first = seen.setdefault(same, component)
        if first is component or first.name is None:
            continue
        yield found(
            "OBK108",
            f"{component.kind} `{component.identity}` of `{node.node_name}` is configured twice, "
            "and this entry is ignored",
            component.name.span,
            severity="warning",
            help="remove it, or correct its name",
            related=(Related(message="the first entry", span=first.name.span),),
        )


def _check_replaced(node: Node) -> Iterator[Diagnostic]:
    """`params` has the last word, so it must not set what other keys of the node set."""
    places = dict(_parameters_of_keys(node))
    for parameter in node.params:
        if parameter.name in places:
            yield found(
                "OBK108",
                f"`params` of `{node.node_name}` sets `{parameter.name}`, and its value would "
                "replace the one that the config has elsewhere",
                parameter.key_span or parameter.span,
                help="remove one of them",
                related=(Related(message="the other one", span=places[parameter.name]),),
            )


def _parameters_of_keys(node: Node) -> Iterator[tuple[str, Span]]:
    """The ROS parameters that the keys of a node set, except `params`, and where."""
    for component in node.used_components:
        if component.identity is not None:
            name = component.ros_parameter or component.key
            place = name.span if name else component.span
            yield f"{component.identity}{SETTING_SUFFIX}", place
            if component.ros_parameter is not None:
                yield component.ros_parameter.value, place
    for group in node.callback_groups[:1]:
        yield CALLBACK_GROUPS_PARAMETER, group.name.span
        yield SETTINGS_PARAMETER, group.name.span
    for component in node.used_components[:1]:
        yield SETTINGS_PARAMETER, component.span
    for sim in node.sims:
        yield sim.parameter, sim.span
    written = {
        "params_path": node.params_path,
        "urdf_path": node.urdf,
        "robot_topic": node.robot_topic,
        "tf_prefix": node.tf_prefix,
    }
    yield from ((name, value.span) for name, value in written.items() if value is not None)


def _check_contradictions(node: Node, code: NodeFacts | None) -> Iterator[Diagnostic]:
    """A `key` beside a `ros_parameter` may be a custom name, but not another component's name.

    The node finds a component by either name.
    """
    owners = {
        (component.kind, _meant(component.name.value)): component
        for component in reversed(node.components)
        if component.name is not None
    }
    for component in node.components:
        parameter, key = component.ros_parameter, component.key
        if key is None:
            continue
        meant = _meant(key.value)
        owner = owners.setdefault((component.kind, meant), component)
        if parameter is None or meant == (own := _meant(parameter.value)):
            continue
        is_other = owner is not component or standard_component(key.value) is not None
        if is_other or _are_two(code, component, parameter, key):
            place = owner.name if owner is not component else None
            yield _contradiction(parameter, key, meant, own, place)
        elif sure_name(meant, (own,)):
            yield _misspelt_key(parameter, key, own)


def _meant(name: str) -> str:
    return standard_component(name) or component_identity(name)


def _are_two(
    code: NodeFacts | None, component: Component, parameter: Spanned[str], key: Spanned[str]
) -> bool:
    """Whether the code registers one component for either name."""
    if code is None:
        return False
    named, keyed = (
        code.component_of(replace(component, ros_parameter=name, key=None))
        for name in (parameter, key)
    )
    return named is not None and keyed is not None and named is not keyed


def _contradiction(
    parameter: Spanned[str],
    key: Spanned[str],
    meant: str,
    own: str,
    owner: Spanned[str] | None,
) -> Diagnostic:
    there = (Related(message=f"the component `{meant}`", span=owner.span),) if owner else ()
    return found(
        "OBK107",
        f"key `{key.value}` names the component `{meant}`, but `ros_parameter` names `{own}`",
        key.span,
        help="remove one of the two",
        related=(Related(message="the `ros_parameter`", span=parameter.span), *there),
    )


def _misspelt_key(parameter: Spanned[str], key: Spanned[str], own: str) -> Diagnostic:
    return found(
        "OBK107",
        f"key `{key.value}` differs slightly from `{own}`, which `ros_parameter` names",
        key.span,
        help=f"write `key: {own}`, or remove `key`",
        related=(Related(message="the `ros_parameter`", span=parameter.span),),
        fix=respell(key.span, key.value, own),
    )


def check_callback_groups(context: CheckContext) -> Iterator[Diagnostic]:
    """Report groups that are used but not defined, or defined but not used, not even by code."""
    undefined = 0
    for node in context.stack.nodes:
        defined = {group.name.value: group for group in node.callback_groups}
        used: set[str] = set()
        for component in node.components:
            group = component.callback_group
            if group is None:
                continue
            # A misspelled group counts as a use of the group with the similar name.
            used.add(group.value)
            if group.value not in defined:
                undefined += 1
                names = defined if undefined <= _MOST_SUGGESTIONS else ()
                used.update(near_names(group.value, names))
                yield _undefined_group(group, node, names)
        unused_groups = {name: group for name, group in defined.items() if name not in used}
        code = code_of(node, context.environment) if unused_groups else None
        for name, unused in unused_groups.items():
            if code is None or name not in code.words:
                message = f"callback group `{name}` of `{node.node_name}` is not used"
                yield found("OBK208", message, unused.name.span)


def _undefined_group(group: Spanned[str], node: Node, names: Collection[str]) -> Diagnostic:
    meant = sure_name(group.value, names)
    return found(
        "OBK207",
        f"callback group `{group.value}` is not defined in `{node.node_name}`",
        group.span,
        help=did_you_mean(group.value, names)
        or f"add `callback_groups: {{{group.value}: MutuallyExclusiveCallbackGroup}}`",
        fix=respell(group.span, group.value, meant) if meant else (),
    )
