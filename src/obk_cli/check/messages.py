"""OBK115, OBK410, OBK411, OBK413: undefined message types and fields."""

import re
from collections.abc import Collection, Iterator
from dataclasses import replace
from typing import Final

from obelisk_spec.names import (
    OBELISK_MESSAGES,
    ROS_MESSAGES,
    near_msg_types,
    resolve_msg_type,
    sure_msg_type,
)
from obelisk_spec.suggestions import ask_for, did_you_mean, list_names, near_names, sure_name
from obk_cli.check.context import CheckContext
from obk_cli.config.environment import CodeComponent, Environment, NodeFacts
from obk_cli.config.fixes import respell
from obk_cli.config.model import Component, Spanned
from obk_cli.diagnostics.diagnostic import Diagnostic, Related, found
from obk_cli.diagnostics.source import Span

__all__ = ["check_message_types", "check_replaced_messages"]

_NO_PACKAGE_HELP: Final = "create a message package in the workspace with `obk new msgs`"
_OF_A_CLASS: Final = re.compile(r"::|\.")
"""Separators between the parts of a type in C++ and in Python."""


def check_message_types(context: CheckContext) -> Iterator[Diagnostic]:
    """Check every type in the config and the code against the sources of installed packages."""
    checked: set[tuple[str, str]] = set()
    written = {
        _package(component.msg_type.value)
        for node in context.stack.nodes
        for component in node.components
        if component.msg_type is not None
    }
    for topic in context.stack.external_topics:
        if topic.msg_type is not None:
            yield from _check(topic.msg_type, context.environment)
    for node in context.stack.nodes:
        for component in node.components:
            if component.msg_type is None or _is_short_for_code(component):
                continue
            faults = _check(component.msg_type, context.environment)
            yield from map(_of_cpp, faults) if component.ignores_type else faults
        if node.pkg is None or node.executable is None:
            continue
        command = (node.pkg.value, node.executable.value)
        code = context.environment.read_node_code(*command)
        if isinstance(code, NodeFacts) and command not in checked:
            checked.add(command)
            yield from _check_code(code, node.executable, context.environment, in_config=written)


def _is_short_for_code(component: Component) -> bool:
    """Whether the config has the bare name of the code's type."""
    assert component.msg_type is not None
    code = component.code_type
    return code is not None and code.rpartition("/")[2] == component.msg_type.value


def _of_cpp(fault: Diagnostic) -> Diagnostic:
    message = f"{fault.message}; a C++ node ignores `msg_type`"
    return replace(fault, severity="info", message=message)


def check_replaced_messages(context: CheckContext) -> Iterator[Diagnostic]:
    """Check that workspace packages that replace Obelisk's define all types that the stack uses."""
    replaced = context.environment.replaced_messages()
    uses = list(_uses(context)) if replaced else []
    for one in replaced:
        types = {f"{one.package}/msg/{name}": name for name in one.types}
        fields = {f"{one.package}/msg/{field.partition('.')[0]}": field for field in one.fields}
        missing = [f"`{name}`" for name in (*one.types, *one.fields)]
        used = [use for use in uses if use[0] in types] or [use for use in uses if use[0] in fields]
        message = f"package `{one.package}` in {one.folder} replaces Obelisk's and lacks "
        message += ", ".join(missing)
        if not used:
            yield found(
                "OBK413",
                message,
                context.stack.span,
                help="no node of this stack seems to use them",
                severity="info",
            )
            continue
        msg_type, span, _ = used[0]
        name = types.get(msg_type)
        yield found(
            "OBK413",
            message,
            span,
            help=f"add `msg/{name}.msg` to the package, or use another type"
            if name
            else f"add the field `{fields[msg_type]}` if the nodes use it",
            related=tuple(related for *_, other in used for related in other),
        )


def _uses(context: CheckContext) -> Iterator[tuple[str, Span, tuple[Related, ...]]]:
    """Full name and location of each message type in config or code."""
    for node in context.stack.nodes:
        sensors = (group.msg_type for sim in node.sims for group in sim.sensor_groups)
        for written in (*(component.msg_type for component in node.components), *sensors):
            if written is not None and (full := resolve_msg_type(written.value)) is not None:
                yield full, written.span, ()
        if node.pkg is None or node.executable is None:
            continue
        code = context.environment.read_node_code(node.pkg.value, node.executable.value)
        if isinstance(code, NodeFacts):
            for component in code.components:
                if component.msg_type is not None and not component.is_of_library:
                    yield component.msg_type, node.executable.span, (_place(component, code),)


def _package(msg_type: str) -> str:
    """The package part of a type; empty for a bare name."""
    return msg_type.partition("/")[0] if "/" in msg_type else ""


def _check(written: Spanned[str], environment: Environment) -> Iterator[Diagnostic]:
    full = resolve_msg_type(written.value)
    if full is None:
        # A workspace package with the name of one of Obelisk's may have more messages.
        owner, _, name = written.value.replace("/msg/", "/").rpartition("/")
        others = [package for package in OBELISK_MESSAGES if owner in ("", package)]
        if not any(name in (environment.message_names(other) or ()) for other in others):
            yield _unknown(written, environment)
        return
    package, _, name = full.partition("/msg/")
    if _is_known(package, name):
        return
    names = environment.message_names(package)
    if names is None:
        # The common ROS packages need not be installed where configs are checked.
        if package not in ROS_MESSAGES:
            yield _no_package(written, package, environment)
    elif name not in names:
        yield _not_in_package(written, package, name, names)


def _is_known(package: str, name: str) -> bool:
    return package in OBELISK_MESSAGES or name in ROS_MESSAGES.get(package, ())


def _check_code(
    code: NodeFacts,
    executable: Spanned[str],
    environment: Environment,
    *,
    in_config: Collection[str],
) -> Iterator[Diagnostic]:
    """Report undefined classes in a node's source; `in_config` has the packages of the config."""
    # Types passed to a base class count too, because the user's code passes them.
    by_type = {c.msg_type: c for c in reversed(code.components) if c.msg_type is not None}
    for msg_type, component in by_type.items():
        package, _, name = msg_type.partition("/msg/")
        if name in ROS_MESSAGES.get(package, ()):
            continue
        names = environment.message_names(package) or OBELISK_MESSAGES.get(package)
        if names is not None and name not in names:
            yield found(
                "OBK410",
                f"`{executable.value}` cannot start: package `{package}` has no message `{name}`",
                executable.span,
                help=did_you_mean(name, names) or "it does not define any messages",
                related=(_place(component, code),),
            )
        elif names is None and package not in (*ROS_MESSAGES, *in_config):
            yield found(
                "OBK411",
                f"`{executable.value}` cannot start: message package `{package}` was not found",
                executable.span,
                help=_near_package(package, environment),
                related=(_place(component, code),),
            )


def _place(component: CodeComponent, code: NodeFacts) -> Related:
    if component.is_of_library:
        return Related(message="the class", span=code.span)
    return Related(message=f"the {component.kind} is registered here", span=component.span)


def _unknown(written: Spanned[str], environment: Environment) -> Diagnostic:
    """Report an unknown bare name, or text that cannot be a type."""
    name = written.value
    own = _own_types(environment) if "/" not in name else {}
    near = tuple(own[bare] for bare in near_names(name, own)) or near_msg_types(name)
    meant = own.get(name) or sure_msg_type(name)
    as_class = _OF_A_CLASS.sub("/", name)
    if "/" not in name and resolve_msg_type(as_class) is not None:
        near, meant = (as_class,), as_class
    return found(
        "OBK115",
        f"message type `{name}` is not known",
        written.span,
        help=ask_for(near) or "for your own message, include the package: `my_msgs/MyMessage`",
        fix=respell(written.span, name, meant) if meant else (),
    )


def _own_types(environment: Environment) -> dict[str, str]:
    """Bare name -> full name to write, for messages of the workspace."""
    return {
        name: f"{package}/{name}"
        for package in environment.message_packages()
        if package not in OBELISK_MESSAGES
        for name in environment.message_names(package) or ()
    }


def _not_in_package(
    written: Spanned[str], package: str, name: str, names: tuple[str, ...]
) -> Diagnostic:
    meant = sure_name(name, names)
    spelled = written.value.removesuffix(name)
    near = ask_for(f"{spelled}{one}" for one in near_names(name, names))
    there_is = f"available: {list_names(names)}" if names else "it does not define any messages"
    return found(
        "OBK115",
        f"package `{package}` has no message `{name}`",
        written.span,
        help=near or there_is,
        fix=respell(written.span, written.value, f"{spelled}{meant}") if meant else (),
    )


def _no_package(written: Spanned[str], package: str, environment: Environment) -> Diagnostic:
    return found(
        "OBK411",
        f"message type `{written.value}`: package `{package}` was not found",
        written.span,
        help=_near_package(package, environment),
    )


def _near_package(package: str, environment: Environment) -> str:
    known = {*environment.message_packages(), *OBELISK_MESSAGES, *ROS_MESSAGES}
    meant = sure_name(package, known)
    near = ask_for((meant,) if meant else near_names(package, known))
    return near or _NO_PACKAGE_HELP
