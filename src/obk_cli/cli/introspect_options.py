"""Options of the commands that look into a running stack."""

import json
import sys
from typing import TYPE_CHECKING, Annotated, Final

import click
import typer
from click.core import ParameterSource

from obk_cli.cli.complete import complete_nodes, complete_topics
from obk_cli.cli.options import require_positive
from obk_cli.errors import MisuseError

__all__ = [
    "TIMEOUT_S",
    "DomainOption",
    "NodeArgument",
    "TimeoutOption",
    "TopicArgument",
    "here",
    "load_message",
    "print_json",
    "with_types",
]

if TYPE_CHECKING:
    from obk_cli.introspect.target import GraphTarget


TIMEOUT_S: Final = 5.0
"""Longer than any node takes to be found [s]."""
GIVEN: Final = (ParameterSource.COMMANDLINE, ParameterSource.ENVIRONMENT)

DomainOption = Annotated[
    int | None,
    typer.Option(min=0, max=232, help="The ROS domain; else ROS_DOMAIN_ID, else a stack's here."),
]
TopicArgument = Annotated[
    str, typer.Argument(help="Its name or the end.", autocompletion=complete_topics)
]
NodeArgument = Annotated[
    str, typer.Argument(help="A node, full or in short.", autocompletion=complete_nodes)
]
TimeoutOption = Annotated[
    float,
    typer.Option(help="Seconds to wait for whoever is to answer; unless given, 1 for anybody."),
]


def here(domain: int | None, timeout_s: float) -> "GraphTarget":
    """Where to look, by these options of a command.

    Raises:
        CommandFailedError: ROS_DOMAIN_ID is no domain.
        MisuseError: the time is none.
    """
    from obk_cli.introspect.target import NO_NODES_S, target_of
    from obk_cli.ros.environment import ros_environment

    require_positive("--timeout", timeout_s, "seconds")
    environment = ros_environment()
    for note in environment.notes:
        print(f"warning: {note}", file=sys.stderr)
    is_asked_for = click.get_current_context().get_parameter_source("timeout") in GIVEN
    return target_of(environment, domain, timeout_s if is_asked_for else NO_NODES_S)


def with_types(target: "GraphTarget") -> "GraphTarget":
    """The target, with the message types of its stacks known to this process too."""
    from obk_cli.introspect.target import find_message_types  # slow, and `--help` needs none

    return find_message_types(target)


def print_json(value: object) -> None:
    """Print a result for a program."""
    print(json.dumps(value, indent=1))


def load_message(text: str) -> object:
    """The value that a user writes for a message; empty: none.

    Raises:
        MisuseError: it is not YAML.
    """
    from obelisk_spec.yaml_core import YamlTextError, load_yaml_core

    try:
        return load_yaml_core(text)
    except YamlTextError as error:
        raise MisuseError(
            f"the message is not YAML: {error}", help="write it as '{field: value, other: [1, 2]}'"
        ) from error
