"""Names that ROS must take, checked where they are written."""

from collections.abc import Callable

from obelisk_spec.names import (
    namespace_fault,
    node_name_fault,
    package_name_fault,
    topic_name_fault,
)
from obk_cli.config import Spanned
from obk_cli.diagnostics import found
from obk_cli.read.fields import Faults

__all__ = ["check_namespace", "check_node_name", "check_package", "check_topic"]


def check_topic(topic: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The topic, with a finding if it is none."""
    return _checked(topic, topic_name_fault, "OBK109", "a topic name", faults)


def check_namespace(name: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The namespace, with a finding if it is none."""
    return _checked(name, namespace_fault, "OBK110", "a namespace", faults)


def _name_part_fault(name: str) -> str | None:
    # A digit may come first: the whole name starts with `obelisk_`.
    return node_name_fault(f"n{name}")


def check_node_name(name: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The node's name part, with a finding if it can be none."""
    return _checked(name, _name_part_fault, "OBK110", "part of a node name", faults)


def check_package(name: Spanned[str] | None, faults: Faults) -> Spanned[str] | None:
    """The package's name, with a finding if it is none."""
    return _checked(name, package_name_fault, "OBK111", "a package name", faults)


def _checked(
    name: Spanned[str] | None,
    fault_of: Callable[[str], str | None],
    code: str,
    what: str,
    faults: Faults,
) -> Spanned[str] | None:
    fault = fault_of(name.value) if name else None
    if name is not None and fault is not None:
        faults.append(found(code, f"`{name.value}` cannot be {what}: {fault}", name.span))
    # A wrong name is kept: what it stands for is still there, and is not to be reported missing.
    return name
