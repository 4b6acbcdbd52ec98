"""OBK107, OBK108, OBK207, OBK208: the components of one node against each other."""

from collections.abc import Collection, Iterator

from obelisk_spec.components import component_identity, standard_component
from obelisk_spec.near import did_you_mean, near_names, sure_name
from obk_cli.config import Component, Node, Spanned, Stack
from obk_cli.cures import respell
from obk_cli.diagnostics import Diagnostic, Related, found
from obk_cli.surroundings import Surroundings

__all__ = ["check_callback_groups", "check_components"]

_MOST_SUGGESTIONS = 200
"""Findings that are compared with what exists."""


def check_components(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Two entries for one component, and names that contradict each other."""
    for node in stack.nodes:
        yield from _check_twice(node)
        for component in node.components:
            yield from _check_contradiction(component, node)


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
            f"{component.kind} `{component.identity}` of `{node.node_name}` is configured twice",
            component.name.span,
            related=(Related(message="the first time", span=first.name.span),),
        )


def _check_contradiction(component: Component, node: Node) -> Iterator[Diagnostic]:
    parameter, key = component.ros_parameter, component.key
    if parameter is None or key is None:
        return
    meant = standard_component(key.value) or component_identity(key.value)
    own = standard_component(parameter.value) or component_identity(parameter.value)
    others = {
        other.identity
        for other in node.components
        if other is not component and other.kind == component.kind
    }
    if meant == own or not (standard_component(key.value) or meant in others):
        return
    yield found(
        "OBK107",
        f"key `{key.value}` names the component `{meant}`, `ros_parameter` names `{own}`",
        key.span,
        help="remove one of the two",
        related=(Related(message="the `ros_parameter`", span=parameter.span),),
    )


def check_callback_groups(stack: Stack, _: Surroundings) -> Iterator[Diagnostic]:
    """Groups that are used and not defined, or defined and not used."""
    undefined = 0
    for node in stack.nodes:
        defined = {group.name.value: group for group in node.callback_groups}
        used: set[str] = set()
        for component in node.components:
            group = component.callback_group
            if group is None:
                continue
            # A misspelt group counts as a use of the one that it is near to.
            used.add(group.value)
            if group.value not in defined:
                undefined += 1
                names = defined if undefined <= _MOST_SUGGESTIONS else ()
                used.update(near_names(group.value, names))
                yield _undefined_group(group, node, names)
        for name, unused in defined.items():
            if name not in used:
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
