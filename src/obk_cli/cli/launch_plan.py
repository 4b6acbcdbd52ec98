"""Apply the options of `obk launch` to the plan of a config."""

from collections.abc import Sequence
from dataclasses import replace

from obelisk_spec.suggestions import did_you_mean
from obelisk_spec.values import ParameterValue
from obk_cli.cli.options import require_choice
from obk_cli.cli.record import request_of
from obk_cli.config.environment import Environment, NodeFacts
from obk_cli.config.node_reader import LOG_LEVELS
from obk_cli.errors import MisuseError
from obk_cli.introspect.resolve import absolute
from obk_cli.launch.event_loop import Limits
from obk_cli.launch.options import with_simulator_parameters
from obk_cli.launch.process_groups import Share, devices_of
from obk_cli.optional_deps import require_extra
from obk_cli.plan.plan import Plan
from obk_cli.record.recorder_job import RecordRequest

__all__ = [
    "gated_executables",
    "limits_for",
    "recording_of",
    "require_devices",
    "with_log_level",
    "with_viewer",
]


def gated_executables(plan: Plan, environment: Environment | None) -> frozenset[tuple[str, str]]:
    """Package and executable of the nodes whose source shows which node class the library runs.

    Such a program may be started early: it waits at the gate before it creates its node.
    """
    if environment is None:
        return frozenset()
    programs = {(node.package, node.executable) for node in plan.nodes}
    codes = {program: environment.read_node_code(*program) for program in programs}
    return frozenset(
        program
        for program, code in codes.items()
        if isinstance(code, NodeFacts) and code.is_run_by_library
    )


def limits_for(timeout_s: float, hang_s: float) -> Limits:
    """Time limits; a transition limit above the default also allows a longer start and shutdown.

    Args:
        timeout_s: limit for a transition.
        hang_s: how long a node may not answer; 0: forever.
    """
    default = Limits()
    return Limits(
        transition_s=timeout_s,
        start_s=max(timeout_s, default.start_s),
        down_s=timeout_s if timeout_s > default.transition_s else default.down_s,
        hang_s=hang_s or float("inf"),
    )


def require_devices(plan: Plan, device: str | None, lead: str | None) -> None:
    """Check that `--device` and `--lead` name devices of the stack.

    Raises:
        MisuseError: they do not, or only `--lead` is given.
    """
    for option, name in (("--device", device), ("--lead", lead)):
        if name is not None:
            require_choice(option, name, devices_of(plan))
    if lead is not None and device is None:
        raise MisuseError("`--lead` needs `--device`: it names the device whose launch leads")


def recording_of(given: Sequence[str], plan: Plan) -> RecordRequest:
    """What to record: topics given by name or pattern, or the plan's if there are none.

    Raises:
        CommandFailedError: the library for recordings is missing.
        MisuseError: a name without a slash at its start is not that of one of the plan's topics.
    """
    require_extra("mcap", "record")
    known = {
        end.topic: end.msg_type
        for node in plan.nodes
        for end in (*node.publishes, *node.subscribes)
    }
    request = request_of(given, known)
    for name in given:
        full = absolute(name)
        if not name.startswith("/") and full in request.topics and full not in known:
            raise MisuseError(
                f"`--record-topic {name}`: the config has no such topic",
                help=did_you_mean(name, known),
            )
    return request if given else RecordRequest()


def with_viewer(plan: Plan, share: Share, viewer: str | None) -> Plan:
    """The plan with this viewer for the simulated robots that run here.

    Raises:
        MisuseError: no simulated robot runs here.
    """
    parameters: dict[str, ParameterValue] = {} if viewer is None else {"viewer": viewer}
    return with_simulator_parameters(plan, share, parameters, f"--viewer {viewer}")


def with_log_level(plan: Plan, level: str | None) -> Plan:
    """The plan with this log level for nodes that do not set one.

    Raises:
        MisuseError: there is no such level.
    """
    if level is None:
        return plan
    require_choice("--log-level", level, LOG_LEVELS)
    nodes = (replace(node, log_level=node.log_level or level) for node in plan.nodes)
    return replace(plan, nodes=tuple(nodes))
