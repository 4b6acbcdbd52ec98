"""`obk service list|call`: the services of a running stack."""

import json
import re
from typing import TYPE_CHECKING, Annotated, Final

import typer

from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    FormatOption,
    TimeoutOption,
    graph_target,
    print_json,
    wants_json,
    with_types,
)
from obk_cli.errors import EXIT_FAILED, MisuseError

if TYPE_CHECKING:
    from obk_cli.introspect.target import GraphTarget
    from obk_cli.ros.message_data import Plain

__all__ = ["app"]

_SERVICE_TYPE: Final = re.compile(r"\w+/srv/\w+", re.ASCII)

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="List and call the services of a running stack.",
)


@app.callback(epilog="Example: obk service call robot_0/pause '{data: true}'")
def _root() -> None:
    """List services and call them."""


@app.command("list", epilog="Example: obk service list --node robot_0")
def list_(
    node: Annotated[
        str | None, typer.Option(metavar="NODE", help="Show only the services of this node.")
    ] = None,
    all_: Annotated[
        bool,
        typer.Option(
            "--all", help="Also show the services that every node has for its parameters."
        ),
    ] = False,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Show the services with their types."""
    is_json = wants_json(format)
    target = graph_target(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph
    from obk_cli.introspect.nodes import services_text
    from obk_cli.introspect.resolve import find_node, settle
    from obk_cli.ros.graph import special_services

    with open_graph(target) as participant:
        of_node = None if node is None else find_node(participant, target, node, timeout)
        settle(participant, target, timeout)
        services = (
            participant.service_types() if of_node is None else participant.services_of(of_node)
        )
    shown = services if all_ else special_services(services)
    if is_json:
        print_json({name: list(types) for name, types in shown.items()})
        return
    print("\n".join(services_text(shown)))


@app.command(epilog="Example: obk service call robot_0/pause '{data: true}'")
def call(
    service: Annotated[
        str, typer.Argument(help="Service name, or a suffix of it, such as robot_0/reset.")
    ],
    request: Annotated[
        str,
        typer.Argument(
            metavar="[REQUEST]", help="Request as YAML. Default: all fields at their defaults."
        ),
    ] = "",
    service_type: Annotated[
        str | None,
        typer.Option(
            "--type",
            metavar="TYPE",
            help="Type as pkg/srv/Name; required if nodes use several.",
        ),
    ] = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Call a service and show the response.

    Every field of REQUEST is checked against the type before the call. Exit code 1 if no response
    arrives in time, or if the response has `success: false`.
    """
    is_json = wants_json(format)
    if service_type is not None and not _SERVICE_TYPE.fullmatch(service_type):
        raise MisuseError(
            f"`--type {service_type}`: expected a type such as `std_srvs/srv/Trigger`"
        )
    target = graph_target(domain, timeout)

    from obk_cli.cli.options import load_message
    from obk_cli.introspect.message_text import json_line, message_text

    value = load_message(request)
    response = _call(with_types(target), service, service_type, value, timeout)
    if is_json:
        print(json.dumps(json.loads(json_line(response)), indent=1))
    else:
        print("\n".join(message_text(response, is_whole=True)))
    if isinstance(response, dict) and response.get("success") is False:
        raise typer.Exit(EXIT_FAILED)


def _call(
    target: "GraphTarget", service: str, service_type: str | None, request: object, timeout_s: float
) -> "Plain":
    """Call a service and return its response."""
    from obk_cli.introspect.resolve import find_service, the_type
    from obk_cli.ros.message_data import plain_data, require_fit
    from obk_cli.ros.participant import open_participant
    from obk_cli.ros.services import ServiceClient
    from obk_cli.ros.types import fields_of, find_type, make_message

    with open_participant(target.environment, ("rosidl_generator_py",)) as participant:
        name = find_service(participant, target, service, timeout_s)
        types = (service_type,) if service_type else participant.service_types()[name]
        kind = the_type("service", name, types)
        data = require_fit(request, f"{kind}_Request", fields_of)
        client = ServiceClient(participant, name, find_type(kind))
        return plain_data(client.call(make_message(f"{kind}_Request", data), timeout_s))
