"""`obk topic pub TOPIC [TYPE] [MESSAGE]`: messages written as YAML, published once or at a rate."""

import sys
import time
from typing import TYPE_CHECKING, Annotated

import typer

from obelisk_spec.messages import near_msg_types, resolve_msg_type
from obelisk_spec.names import topic_name_fault
from obelisk_spec.near import did_you_mean, list_names
from obk_cli.cli.looking_options import (
    TIMEOUT_S,
    DomainOption,
    TimeoutOption,
    TopicArgument,
    here,
    with_types,
)
from obk_cli.cli.option_values import require_positive
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.looking.graph import TopicSeen
from obk_cli.looking.place import Place

if TYPE_CHECKING:
    from obk_cli.adapters.ros_look import RosLook

__all__ = ["EXAMPLE", "command"]

EXAMPLE = """\b
Example: obk topic pub /gain std_msgs/msg/Float64 '{data: 0.5}' --once
         obk topic pub goal '{header: auto, q_joints: [0.1, 0.2]}' --rate 10
"""


def command(
    topic: TopicArgument,
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[TYPE] [MESSAGE]", help="As in a config or pkg/msg/Name, and as YAML."
        ),
    ] = None,
    once: Annotated[bool, typer.Option("--once", help="One message, then end.")] = False,
    count: Annotated[
        int | None, typer.Option("--count", "-n", min=1, help="As many messages, then end.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Messages per second.")] = 1.0,
    wait_for: Annotated[
        int, typer.Option(min=0, help="How many subscribers to wait for before the first.")
    ] = 1,
    allow_foreign: Annotated[
        bool, typer.Option("--allow-foreign", help="Publish on a topic that moves a robot, too.")
    ] = False,
    domain: DomainOption = None,
    timeout: TimeoutOption = TIMEOUT_S,
) -> None:
    """Publish messages on a topic, until Ctrl-C.

    TYPE may be left out where the topic has one. Fields that MESSAGE does not name are as they are
    by default; `header: auto` and `stamp: now` are the time of publishing. Every field is checked
    against the type before anything is sent. Topics that a running robot listens to are refused
    unless --allow-foreign is given.
    """
    require_positive("--rate", rate)
    msg_type, text = _type_and_text(words or [])
    place = with_types(here(domain, timeout))
    most = 1 if once else count

    from obk_cli.adapters.allowed_publisher import ALLOWED_PUBLISHER
    from obk_cli.adapters.ros_look import LOOKER, open_look
    from obk_cli.adapters.ros_publisher import RosPublisher
    from obk_cli.adapters.ros_types import fields_of, find_type, make_message
    from obk_cli.cli.message_argument import load_message
    from obk_cli.looking.fill import require_fit

    value = load_message(text)

    node = ALLOWED_PUBLISHER if allow_foreign else LOOKER
    with open_look(place.environment, place.modules([topic]), node) as look:
        seen = _topic(look, place, topic, msg_type, timeout)
        full_type = msg_type or seen.msg_types[0]
        data = require_fit(value, full_type, fields_of)
        if not allow_foreign:
            _refuse_moving(seen, place)
        is_latched = any(e.qos.durability == "transient_local" for e in seen.subscriptions)
        publisher = RosPublisher(
            look, seen.name, find_type(full_type), is_transient_local=is_latched
        )
        if not look.wait_for(lambda: publisher.subscribers >= wait_for or None, timeout):
            _require_type(look.topic(seen.name), full_type)
            raise CommandFailedError(
                f"{publisher.subscribers} of {wait_for} subscribers of {seen.name} came within "
                f"{timeout:g} s",
                help="`--wait-for 0` publishes without any",
            )
        # Nodes of other hosts may have become known only now.
        if not allow_foreign:
            _refuse_moving(look.topic(seen.name), place)
        begin, sent = time.monotonic(), 0
        while most is None or sent < most:
            publisher.until(begin + sent / rate)
            publisher.publish(make_message(full_type, data))
            sent += 1
        if not publisher.rest():
            print("warning: not every subscriber has confirmed the last message", file=sys.stderr)
        print(f"published {sent} message{'s' if sent > 1 else ''} on {seen.name}")


def _type_and_text(words: list[str]) -> tuple[str | None, str]:
    """The full type, None where none is given, and the message among what follows the topic.

    Raises:
        MisuseError: there is more than the two, or the first of two is no type.
    """
    written = words[0] if words else ""
    full = resolve_msg_type(written)
    if full is None and written.count("/") == 2 and not set(written) & set(" {}:[]"):
        full = written  # whether its package has it is seen when it is looked up
    rest = words[1:] if full else words
    if len(words) == 2 and full is None:
        raise MisuseError(
            f"message type `{written}` is not known",
            help=did_you_mean(written, near_msg_types(written))
            or "TOPIC [TYPE] [MESSAGE], the message in quotes",
        )
    if len(rest) > 1:
        raise MisuseError(
            f"`{rest[1]}` is too much",
            help="TOPIC [TYPE] [MESSAGE], the message in quotes",
        )
    return full, rest[0] if rest else ""


def _topic(
    look: "RosLook", place: Place, name: str, msg_type: str | None, timeout_s: float
) -> TopicSeen:
    """The topic; one that nobody has yet needs a full name and a type.

    Raises:
        CommandFailedError: there is none of that name, or it has another type.
        MisuseError: a new one's name is none.
    """
    from obk_cli.looking.finding import find_topic, the_type

    if msg_type is None or not name.startswith("/"):
        seen = find_topic(look, place, name, timeout_s, is_heard=False)
        the_type("topic", seen.name, {msg_type} if msg_type else seen.msg_types)
    else:
        if fault := topic_name_fault(name):
            raise MisuseError(f"`{name}` is no topic: {fault}")
        # Who listens is to be known, for the sake of robots.
        look.settle(place.nodes, 0.5, timeout_s if place.nodes else 0.5)
        seen = look.topic(name)
    if msg_type is not None:
        _require_type(seen, msg_type)
    return seen


def _require_type(topic: TopicSeen, msg_type: str) -> None:
    others = [end.msg_type for end in topic.subscriptions if end.msg_type != msg_type]
    if others and len(others) == len(topic.subscriptions):
        raise CommandFailedError(
            f"{topic.name} is of the type {others[0]}, not {msg_type}",
            help="nobody would hear the messages",
        )


def _refuse_moving(topic: TopicSeen, place: Place) -> None:
    from obk_cli.looking.guard import moved_by

    if robots := moved_by(topic, place.plans):
        raise CommandFailedError(
            f"{topic.name} moves {list_names(robots)}, which runs in the ROS domain {place.domain}",
            help="publish there only on purpose, with `--allow-foreign`",
        )
