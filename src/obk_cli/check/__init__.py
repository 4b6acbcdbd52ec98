"""Every check of a typed config, in the order in which they run. Each finds and none changes."""

from collections.abc import Callable, Iterator

from obk_cli.check.components import check_callback_groups, check_components
from obk_cli.check.graph import check_node_names, check_required_sections
from obk_cli.check.model import check_models
from obk_cli.check.packages import check_executables, check_files
from obk_cli.check.topics import check_dangling, check_qos, check_types, check_unread
from obk_cli.config import Stack
from obk_cli.diagnostics import Diagnostic
from obk_cli.surroundings import Surroundings

__all__ = ["CHECKS", "Check", "check_stack"]

Check = Callable[[Stack, Surroundings], Iterator[Diagnostic]]

CHECKS: tuple[Check, ...] = (
    check_components,
    check_callback_groups,
    check_required_sections,
    check_node_names,
    check_dangling,
    check_types,
    check_qos,
    check_unread,
    check_models,
    check_executables,
    check_files,
)


def check_stack(stack: Stack, surroundings: Surroundings) -> tuple[Diagnostic, ...]:
    """The findings of all checks."""
    return tuple(fault for check in CHECKS for fault in check(stack, surroundings))
