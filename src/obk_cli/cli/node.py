"""`obk node list|info`: the nodes of a running stack."""

from typing import Annotated

import typer

from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    FormatOption,
    NodeArgument,
    TimeoutOption,
    graph_target,
    print_json,
    require_positive,
    wants_json,
)

__all__ = ["app"]

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Inspect the nodes of a running stack.",
)


@app.callback(epilog="Example: obk node info control_0")
def _root() -> None:
    """Inspect nodes. Short names work too: control_0."""


@app.command("list", epilog="Example: obk node list --format json")
def list_(
    wait: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Seconds to spend discovering nodes not started by obk; 3.3 s finds all.",
        ),
    ] = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """List all nodes.

    Nodes that `obk launch` started on this host are listed with their state and process.
    """
    is_json = wants_json(format)
    require_positive("--wait", wait, "a number of seconds")
    target = graph_target(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph
    from obk_cli.introspect.nodes import known_nodes, nodes_data, nodes_text
    from obk_cli.introspect.resolve import settle

    with open_graph(target) as source:
        settle(source, target, timeout, wait_s=wait)
        nodes = source.nodes()
    known = known_nodes(target)
    if is_json:
        print_json(nodes_data(nodes, known))
        return
    print("\n".join(nodes_text(nodes, known)))


@app.command(epilog="Example: obk node info control_0")
def info(
    node: NodeArgument,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Show a node's topics, services, parameters, state and process.

    For nodes that `obk launch` started on this host, the launcher reports the state; otherwise the
    node does.
    """
    is_json = wants_json(format)
    target = graph_target(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph
    from obk_cli.introspect.nodes import inspect_node, node_data, node_text
    from obk_cli.introspect.resolve import find_node, settle

    with open_graph(target, node, asks_nodes=True) as source:
        name = find_node(source, target, node, timeout)
        settle(source, target, timeout)
        seen = inspect_node(source, target, name, timeout)
    if is_json:
        print_json(node_data(seen))
        return
    print("\n".join(node_text(seen)))
