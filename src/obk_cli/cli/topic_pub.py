"""`obk topic pub TOPIC [TYPE] [MESSAGE]`: messages written as YAML, published once or at a rate."""

import sys
import time
from typing import TYPE_CHECKING, Annotated

import typer

from obelisk_spec.names import near_msg_types, resolve_msg_type
from obelisk_spec.suggestions import did_you_mean
from obk_cli.cli.options import (
    TIMEOUT_S,
    DomainOption,
    TimeoutOption,
    TopicArgument,
    graph_target,
    require_positive,
    with_types,
)
from obk_cli.errors import MisuseError

if TYPE_CHECKING:
    from obk_cli.introspect.publishing import Publication, Published
    from obk_cli.introspect.target import GraphTarget

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk topic pub /gain std_msgs/msg/Float64 '{data: 0.5}' --once
         obk topic pub goal '{header: auto, q_joints: [0.1, 0.2]}' --rate 10
"""


def command(
    topic: TopicArgument,
    arguments: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[TYPE] [MESSAGE]",
            help="Message type, as in a config or as pkg/msg/Name; then the message as YAML.",
        ),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="Publish one message and exit.")] = False,
    count: Annotated[
        int | None,
        typer.Option("--count", "-n", min=1, help="Publish this many messages and exit."),
    ] = None,
    rate: Annotated[float, typer.Option(help="Messages per second.")] = 1.0,
    wait_for: Annotated[
        int, typer.Option(min=0, help="Number of subscribers to wait for before the first message.")
    ] = 1,
    allow_foreign: Annotated[
        bool, typer.Option("--allow-foreign", help="Also publish on a topic that commands a robot.")
    ] = False,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
) -> None:
    """Publish messages on a topic until Ctrl-C.

    TYPE can be omitted if the topic already has one. Fields missing from MESSAGE keep their
    defaults; `header: auto` and `stamp: now` insert the time of publishing. Every field is checked
    against the type before anything is sent. Topics that a running robot subscribes to are rejected
    unless --allow-foreign is given.
    """
    require_positive("--rate", rate)
    msg_type, text = _split_arguments(arguments or [])
    target = graph_target(domain, timeout)
    most = 1 if once else count

    from obk_cli.cli.options import load_message
    from obk_cli.introspect.publishing import Publication

    publication = Publication(
        topic=topic,
        msg_type=msg_type,
        message=load_message(text),
        subscribers=wait_for,
        timeout_s=timeout,
        may_move=allow_foreign,
    )
    published = _publish(with_types(target), publication, most, rate)
    if not published.is_confirmed:
        print("warning: not every subscriber confirmed the last message", file=sys.stderr)
    messages = "messages" if published.count > 1 else "message"
    print(f"published {published.count} {messages} on {published.topic}")


def _publish(
    target: "GraphTarget", publication: "Publication", most: int | None, rate_hz: float
) -> "Published":
    """Publish messages.

    Args:
        target: the ROS graph.
        publication: topic, type and message.
        most: number of messages; None: until Ctrl-C.
        rate_hz: messages per second.
    """
    from obk_cli.introspect.publishing import (
        Published,
        refuse_robot_commands,
        topic_to_publish,
        wait_for_subscribers,
    )
    from obk_cli.ros.message_data import require_fit
    from obk_cli.ros.participant import OBSERVER_NODE, open_participant
    from obk_cli.ros.publisher import ALLOWED_PUBLISHER, RosPublisher
    from obk_cli.ros.types import fields_of, find_type, make_message

    node = ALLOWED_PUBLISHER if publication.may_move else OBSERVER_NODE
    with open_participant(
        target.environment, target.modules([publication.topic]), node
    ) as participant:
        seen, kind = topic_to_publish(participant, target, publication)
        data = require_fit(publication.message, kind, fields_of)
        if not publication.may_move:
            refuse_robot_commands(seen, target, "--allow-foreign")
        publisher = RosPublisher(participant, seen, find_type(kind))
        wait_for_subscribers(
            participant, seen.name, kind, publication, lambda: publisher.subscribers
        )
        publisher.wait_until_discovered(participant.topic(seen.name))
        # Nodes on other hosts may have been discovered only now.
        if not publication.may_move:
            refuse_robot_commands(participant.topic(seen.name), target, "--allow-foreign")
        start, sent = time.monotonic(), 0
        while most is None or sent < most:
            publisher.until(start + sent / rate_hz)
            publisher.publish(make_message(kind, data))
            sent += 1
        return Published(topic=seen.name, count=sent, is_confirmed=publisher.rest())


def _split_arguments(arguments: list[str]) -> tuple[str | None, str]:
    """Split the arguments after the topic into the full type (None if omitted) and the message.

    Raises:
        MisuseError: there are more than two arguments, or the first of two is not a type.
    """
    written = arguments[0] if arguments else ""
    full = resolve_msg_type(written)
    if full is None and written.count("/") == 2 and not set(written) & set(" {}:[]"):
        full = written  # the lookup reports whether its package defines it
    rest = arguments[1:] if full else arguments
    if len(arguments) == 2 and full is None:
        raise MisuseError(
            f"message type `{written}` is not known",
            help=did_you_mean(written, near_msg_types(written))
            or "write TOPIC [TYPE] [MESSAGE], with quotes around the message",
        )
    if len(rest) > 1:
        raise MisuseError(
            f"unexpected argument `{rest[1]}`",
            help="write TOPIC [TYPE] [MESSAGE], with quotes around the message",
        )
    return full, rest[0] if rest else ""
