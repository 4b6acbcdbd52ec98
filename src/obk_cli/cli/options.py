"""Options and checks that several commands share; importing this module loads only typer."""

import json
import sys
from collections.abc import Collection
from typing import TYPE_CHECKING, Annotated, Final

import click
import typer
from click.core import ParameterSource

from obelisk_spec.suggestions import ask_for, list_names, near_names
from obk_cli.cli.complete import complete_nodes, complete_topics
from obk_cli.errors import MisuseError

__all__ = [
    "TIMEOUT_S",
    "DomainOption",
    "FormatOption",
    "NodeArgument",
    "RunArgument",
    "TimeoutOption",
    "TopicArgument",
    "TopicsOption",
    "graph_target",
    "load_message",
    "note_if_incomplete",
    "print_json",
    "print_note",
    "require_choice",
    "require_positive",
    "wants_json",
    "with_types",
]

if TYPE_CHECKING:
    from obelisk_recordings.run import RecordedRun
    from obk_cli.introspect.target import GraphTarget


TIMEOUT_S: Final = 5.0
"""More than enough time to discover any node [s]."""
GIVEN: Final = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)

DomainOption = Annotated[
    int | None,
    typer.Option(
        min=0,
        max=232,
        help="ROS domain. Default: ROS_DOMAIN_ID if set, otherwise the domain of a stack on this "
        "host.",
    ),
]
TopicArgument = Annotated[
    str, typer.Argument(help="Topic name, or a suffix of it.", autocompletion=complete_topics)
]
NodeArgument = Annotated[
    str,
    typer.Argument(help="Node name, full or short, or a section.", autocompletion=complete_nodes),
]
RunArgument = Annotated[
    str,
    typer.Argument(
        metavar="FILE|RUN",
        help="File, or the name of a run's folder or config. The "
        "name of a config selects its latest recorded run; `NAME~1` selects the one before that.",
    ),
]
TopicsOption = Annotated[
    list[str] | None,
    typer.Option(metavar="T", help="Use only the topic with this name or suffix; may be repeated."),
]
TimeoutOption = Annotated[
    float,
    typer.Option(
        metavar="SECONDS",
        help="Seconds to wait for a node, a reply or a message.",
        show_default="5, or 1 if there are no nodes",
    ),
]
MOST: Final = 1e6
"""Upper limit for numeric options. As a number of seconds, this is about 11 days; the system
limits a wait to 24 days."""


def require_choice(option: str, value: str, choices: Collection[str]) -> None:
    """Reject a value that an option does not take.

    Raises:
        MisuseError: the help suggests similar values.
    """
    if value not in choices:
        expected = f"{'one of ' if len(choices) > 1 else ''}{list_names(choices)}"
        raise MisuseError(
            f"`{option} {value}`: expected {expected}",
            help=ask_for(near_names(value, choices)),
        )


def require_positive(option: str, number: float | None, what: str = "a number") -> None:
    """Reject the value of an option if it is not positive or is implausibly large.

    Args:
        option: its name on the command line.
        number: its value; None if not given.
        what: noun for the message ("a number of seconds").

    Raises:
        MisuseError: the message gives the limit.
    """
    if number is None or 0 < number <= MOST:
        return
    limit = f"up to {MOST:.0f}" if number > MOST else "above 0"
    raise MisuseError(f"`{option} {number:g}`: expected {what} {limit}")


FormatOption = Annotated[str, typer.Option(metavar="text|json", help="Output format.")]


def wants_json(format: str) -> bool:
    """Whether to print JSON.

    Raises:
        MisuseError: the format is neither `text` nor `json`.
    """
    if format not in ("text", "json"):
        raise MisuseError(f"`--format {format}`: expected `text` or `json`")
    return format == "json"


def graph_target(domain: int | None, timeout_s: float) -> "GraphTarget":
    """The ROS graph that a command's options select.

    Raises:
        CommandFailedError: ROS_DOMAIN_ID is not a valid domain.
        MisuseError: the timeout is not above 0.
    """
    from obk_cli.introspect.target import NO_NODES_S, target_of
    from obk_cli.ros.environment import ros_environment

    require_positive("--timeout", timeout_s, "a number of seconds")
    environment = ros_environment()
    for note in environment.notes:
        print(f"warning: {note}", file=sys.stderr)
    is_given = click.get_current_context().get_parameter_source("timeout") in GIVEN
    return target_of(environment, domain, timeout_s if is_given else NO_NODES_S)


def with_types(target: "GraphTarget") -> "GraphTarget":
    """The target, after making the message types of its stacks known to this process."""
    from obk_cli.introspect.target import find_message_types  # slow to import

    return find_message_types(target)


def print_note(text: str) -> None:
    """Print a note for the user on stderr."""
    print(f"note: {text}", file=sys.stderr)


def note_if_incomplete(run: "RecordedRun") -> None:
    """Print a note if a recording was not closed."""
    if not run.bag.is_complete:
        print_note(f"{run.path} is incomplete: its recorder did not close it")


def print_json(value: object) -> None:
    """Print a result as JSON, for other programs to read."""
    print(json.dumps(value, indent=1))


def load_message(text: str) -> object:
    """Parse the YAML that a user gives for a message; empty text gives no fields.

    Raises:
        MisuseError: the text is not valid YAML.
    """
    from obelisk_spec.yaml_core import YamlTextError, load_yaml_core

    try:
        return load_yaml_core(text)
    except YamlTextError as error:
        raise MisuseError(
            f"the message is not valid YAML: {error}",
            help="write it as '{field: value, other: [1, 2]}'",
        ) from error
