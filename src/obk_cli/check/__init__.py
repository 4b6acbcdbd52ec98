"""All checks of a typed config, in the order in which they run. None of them changes the config."""

from collections.abc import Callable, Iterator

from obk_cli.check.code import check_code
from obk_cli.check.context import CheckContext
from obk_cli.check.determinism import check_lockstep
from obk_cli.check.loop import (
    check_control_topics,
    check_loop,
    check_outliers,
    check_periods,
    check_timers,
    check_watchdogs,
)
from obk_cli.check.messages import check_message_types, check_replaced_messages
from obk_cli.check.nodes import (
    check_callback_groups,
    check_components,
    check_node_names,
    check_required_sections,
)
from obk_cli.check.packages import check_executables, check_files, check_manifests
from obk_cli.check.simulation import check_controls, check_models, check_policies, check_sim_blocks
from obk_cli.check.style import check_defaults, check_homes
from obk_cli.check.topics import (
    check_doubles,
    check_qos,
    check_sensor_topics,
    check_types,
    check_unconnected_topics,
)
from obk_cli.config.environment import Environment
from obk_cli.config.model import Stack
from obk_cli.config.topology import Topology
from obk_cli.diagnostics.diagnostic import Diagnostic

__all__ = ["check_stack"]

Check = Callable[[CheckContext], Iterator[Diagnostic]]

CHECKS: tuple[Check, ...] = (
    check_components,
    check_callback_groups,
    check_node_names,
    check_message_types,
    check_replaced_messages,
    check_types,
    check_qos,
    check_doubles,
    check_sensor_topics,
    check_control_topics,
    check_timers,
    check_periods,
    check_outliers,
    check_watchdogs,
    check_models,
    check_sim_blocks,
    check_controls,
    check_policies,
    check_executables,
    check_files,
    check_manifests,
    check_code,
    check_homes,
    check_defaults,
)
"""Checks of what the config contains."""

WHOLE_CHECKS: tuple[Check, ...] = (check_required_sections, check_unconnected_topics, check_loop)
"""Checks for missing parts; valid only if no part of the config was lost while reading."""


TEST_CHECKS: tuple[Check, ...] = (check_lockstep,)
"""Checks that only concern lockstep runs."""


def check_stack(
    stack: Stack, environment: Environment, *, is_whole: bool, for_test: bool = False
) -> tuple[Diagnostic, ...]:
    """The findings of all checks.

    Args:
        stack: the typed config.
        environment: the packages and models to look things up in.
        is_whole: whether every included file was read.
        for_test: whether to check the config for lockstep runs, too.
    """
    checks = (*CHECKS, *(WHOLE_CHECKS if is_whole else ()), *(TEST_CHECKS if for_test else ()))
    topology = Topology.of(stack)
    context = CheckContext(stack=stack, topology=topology, environment=environment)
    return tuple(fault for check in checks for fault in check(context))
