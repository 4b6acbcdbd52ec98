"""`obk topic list|info|echo|hz|delay|pub`: the topics of a running stack."""

import sys
from collections.abc import Sequence
from itertools import islice
from typing import TYPE_CHECKING, Annotated

import typer

from obk_cli.cli import topic_pub, topic_rates
from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    FormatOption,
    TimeoutOption,
    TopicArgument,
    graph_target,
    print_json,
    require_positive,
    wants_json,
    with_types,
)
from obk_cli.errors import MisuseError

if TYPE_CHECKING:
    from obk_cli.introspect.message_text import MessageFormatter
    from obk_cli.introspect.target import GraphTarget
    from obk_cli.ros.field_path import Selection

app = typer.Typer(
    add_completion=False,
    rich_markup_mode=None,
    no_args_is_help=True,
    help="Inspect and measure topics, and publish to them.",
)

EXAMPLE = "Example: obk topic echo est q_joints[0]"


@app.callback(epilog=EXAMPLE)
def _root() -> None:
    """Inspect topics, show and publish messages. The end of a topic name is enough."""


@app.command("list", epilog="Example: obk topic list --format json")
def list_(
    all_: Annotated[
        bool, typer.Option("--all", help="Also show hidden topics, such as those of actions.")
    ] = False,
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
    """List topics with types and numbers of endpoints."""
    is_json = wants_json(format)
    require_positive("--wait", wait, "a number of seconds")
    target = graph_target(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph
    from obk_cli.introspect.nodes import topics_data, topics_text
    from obk_cli.introspect.resolve import settle
    from obk_cli.ros.graph import visible

    with open_graph(target) as participant:
        settle(participant, target, timeout, wait_s=wait)
        graph = participant.graph() if all_ else visible(participant.graph())
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
    """Show the publishers and subscribers of a topic with their QoS.

    It also reports incompatible types or QoS, and whether messages use local sockets or DDS, and
    why.
    """
    is_json = wants_json(format)
    target = graph_target(domain, timeout)

    from obk_cli.introspect.graph_source import open_graph
    from obk_cli.introspect.nodes import topic_data, topic_text
    from obk_cli.introspect.resolve import find_topic, settle

    with open_graph(target) as participant:
        found = find_topic(participant, target, topic, timeout, is_published=False)
        settle(participant, target, timeout)
        seen = participant.topic(found.name)
    if is_json:
        print_json(topic_data(seen, target.sockets))
        return
    print("\n".join(topic_text(seen, target.sockets)))


ECHO_EXAMPLE = """\b
Example: obk topic echo est q_joints[0] --once
         obk topic echo est --csv -n 1000 > est.csv
"""


@app.command(epilog=ECHO_EXAMPLE)
def echo(
    topic: TopicArgument,
    fields: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[FIELD...]",
            help="Show only these fields, such as q_joints[0] or header.stamp.",
        ),
    ] = None,
    field: Annotated[
        list[str] | None,
        typer.Option(metavar="FIELD", help="Show only this field; may be repeated."),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Stop after one message.")] = False,
    count: Annotated[
        int | None, typer.Option("--count", "-n", min=1, help="Stop after this many messages.")
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="Show long arrays in full.")] = False,
    csv: Annotated[
        bool, typer.Option("--csv", help="Print one CSV row per message, after a header row.")
    ] = False,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
    format: Annotated[
        str,
        typer.Option(
            metavar="text|json|csv", help="Output format; json prints one object per line."
        ),
    ] = "text",
) -> None:
    """Print the messages of a topic until Ctrl-C.

    The subscription uses the publisher's QoS, so best-effort and latched (transient-local) messages
    are received. --timeout limits the wait for the topic and the first message; with --once or
    --count, the wait for each message. The first message defines the CSV columns.
    """
    if format not in ("text", "json", "csv"):
        raise MisuseError(f"`--format {format}`: expected `text`, `json` or `csv`")
    if csv and format == "json":
        raise MisuseError("`--csv` and `--format json` cannot be combined")
    most = 1 if once else count

    from obk_cli.introspect.message_text import MessageFormatter
    from obk_cli.ros.field_path import parse_selection

    selections = [parse_selection(text) for text in (*(fields or ()), *(field or ()))]
    formatter = MessageFormatter(selections, "csv" if csv else format, is_whole=full, warn=_warn)
    _print_messages(
        with_types(graph_target(domain, timeout)), topic, selections, formatter, most, timeout
    )


def _print_messages(
    target: "GraphTarget",
    topic: str,
    selections: "Sequence[Selection]",
    formatter: "MessageFormatter",
    most: int | None,
    timeout_s: float,
) -> None:
    """Print the messages that a subscription receives."""
    from obk_cli.introspect.resolve import find_topic, the_type
    from obk_cli.ros.field_path import check_selection
    from obk_cli.ros.participant import open_participant
    from obk_cli.ros.raw_subscription import DropCounter, messages
    from obk_cli.ros.types import fields_of, find_type, short_type

    needs = ("rclpy.serialization", *target.modules([topic]))
    with open_participant(target.environment, needs) as participant:
        seen = find_topic(participant, target, topic, timeout_s)
        msg_type = the_type("topic", seen.name, seen.published_types)
        python_type = find_type(msg_type)
        for selection in selections:
            check_selection(selection, short_type(msg_type), fields_of)
        raw = participant.subscribe(seen.name, msg_type, python_type)
        drops = DropCounter()
        try:
            for message in islice(messages(raw, drops, timeout_s, each=most is not None), most):
                if lines := list(formatter.lines(message)):
                    print("\n".join(lines), flush=True)
        finally:
            if drops.dropped:
                _warn(
                    f"{drops.dropped} messages were dropped because they arrived faster than "
                    "they could be printed"
                )


def _warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr)


app.command("hz", epilog=topic_rates.HZ_EXAMPLE)(topic_rates.hz)
app.command("delay", epilog=topic_rates.DELAY_EXAMPLE)(topic_rates.delay)
app.command("pub", epilog=topic_pub.EXAMPLE)(topic_pub.command)
