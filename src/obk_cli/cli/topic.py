"""`obk topic list|info|echo|hz|delay|pub`: the topics of a running stack."""

from typing import Annotated

import typer

from obk_cli.cli import topic_echo, topic_pub, topic_rates
from obk_cli.cli.introspect_options import (
    TIMEOUT_S,
    DomainOption,
    TimeoutOption,
    TopicArgument,
    here,
    print_json,
)
from obk_cli.cli.options import FormatOption, require_positive, wants_json

__all__ = ["app"]

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Look at the topics of a running stack.",
)

EXAMPLE = "Example: obk topic echo est q_joints[0]"


@app.callback(epilog=EXAMPLE)
def _root() -> None:
    """Look at topics, hear and publish messages. A topic may be given by the end of its name."""


@app.command("list", epilog="Example: obk topic list --format json")
def list_(
    all_: Annotated[bool, typer.Option("--all", help="Hidden ones too, as actions' are.")] = False,
    wait: Annotated[
        float | None,
        typer.Option(help="Seconds to wait for nodes that nobody here knows of; 3.3 finds all."),
    ] = None,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Show every topic with its type and how many publish and subscribe."""
    is_json = wants_json(format)
    require_positive("--wait", wait, "seconds")
    target = here(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph
    from obk_cli.introspect.nodes import topics_data, topics_text
    from obk_cli.introspect.resolve import settle
    from obk_cli.ros.graph import visible

    with open_graph(target) as look:
        settle(look, target, timeout, wait_s=wait)
        graph = look.graph() if all_ else visible(look.graph())
    if is_json:
        print_json(topics_data(graph))
        return
    print("\n".join(topics_text(graph)))


@app.command(epilog="Example: obk topic info est")
def info(
    topic: TopicArgument,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: FormatOption = "text",
) -> None:
    """Show who publishes on a topic and who subscribes, each with quality of service.

    Ends that do not hear each other, for their type or quality of service, are told.
    """
    is_json = wants_json(format)
    target = here(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph
    from obk_cli.introspect.nodes import topic_data, topic_text
    from obk_cli.introspect.resolve import find_topic, settle

    with open_graph(target) as look:
        found = find_topic(look, target, topic, timeout, is_heard=False)
        settle(look, target, timeout)
        seen = look.topic(found.name)
    if is_json:
        print_json(topic_data(seen))
        return
    print("\n".join(topic_text(seen)))


app.command("echo", epilog=topic_echo.EXAMPLE)(topic_echo.command)
app.command("hz", epilog=topic_rates.HZ_EXAMPLE)(topic_rates.hz)
app.command("delay", epilog=topic_rates.DELAY_EXAMPLE)(topic_rates.delay)
app.command("pub", epilog=topic_pub.EXAMPLE)(topic_pub.command)
