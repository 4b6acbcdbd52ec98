"""What the user wants made: the typed answers, and the checks that they pass.

In: the words typed on the command line. Out: `Answers`, or every problem with them at once.
Never touches the disk and never imports a message.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

from obelisk_spec.messages import near_msg_types, resolve_msg_type
from obelisk_spec.near import list_names
from obk_cli.scaffold.names import Problem, check_name

__all__ = ["Answers", "Kind", "MessageType", "Question", "check_answers"]

Kind = Literal["controller", "estimator"]

_CLASSES_IN_USE = (
    "Iterator",
    "LifecycleState",
    "ObeliskController",
    "ObeliskEstimator",
    "TransitionCallbackReturn",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MessageType:
    """A ROS message type by its two names."""

    package: str
    name: str

    @property
    def full(self) -> str:
        """`pkg/msg/Name`."""
        return f"{self.package}/msg/{self.name}"

    @property
    def module(self) -> str:
        """The Python module that holds the class."""
        return f"{self.package}.msg"

    @property
    def spelling(self) -> str:
        """As a config writes it: bare where the bare name means this type, else in full."""
        return self.name if resolve_msg_type(self.name) == self.full else self.full


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """What was asked for, as typed."""

    kind: Kind
    name: str
    ctrl_msg: str = "PositionSetpoint"
    est_msg: str = "EstimatedState"
    sensor_msg: str = "JointEncoders"


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """What is to be made; every name in it has been checked."""

    kind: Kind
    package: str
    node: str
    ctrl: MessageType
    est: MessageType
    sensor: MessageType

    @property
    def class_name(self) -> str:
        """The node's class: `foo` and `foo_controller` both give `FooController`."""
        words = self.node.removesuffix(f"_{self.kind}").split("_")
        return "".join(word.capitalize() for word in (*words, self.kind))

    @property
    def messages(self) -> tuple[MessageType, ...]:
        """The message types that this kind of node works with."""
        return (self.ctrl, self.est) if self.kind == "controller" else (self.est, self.sensor)

    def in_package(self, package: str) -> "Answers":
        """The same node in a package of another name."""
        return replace(self, package=package)


def check_answers(
    question: Question, *, owner_of: Callable[[str], str | None]
) -> Answers | tuple[Problem, ...]:
    """Check all that was typed; the node goes into a new package of its own name.

    `owner_of` tells who has a top-level module name already, None if nobody.
    """
    name = check_name(question.name, kind=question.kind, owner_of=owner_of)
    ctrl = _check_message("--ctrl-msg", question.ctrl_msg)
    est = _check_message("--est-msg", question.est_msg)
    sensor = _check_message("--sensor-msg", question.sensor_msg)
    if (
        name is None
        and isinstance(ctrl, MessageType)
        and isinstance(est, MessageType)
        and isinstance(sensor, MessageType)
    ):
        answers = Answers(
            kind=question.kind,
            package=question.name,
            node=question.name,
            ctrl=ctrl,
            est=est,
            sensor=sensor,
        )
        return _check_clashes(answers) or answers
    return tuple(p for p in (name, ctrl, est, sensor) if isinstance(p, Problem))


def _check_message(option: str, written: str) -> MessageType | Problem:
    full = resolve_msg_type(written)
    if full is not None:
        package, _, name = full.partition("/msg/")
        return MessageType(package=package, name=name)
    near = near_msg_types(written)
    return Problem(
        sentence=f"{option}: there is no message type `{written}`",
        help=f"did you mean {list_names(near)}? A type of your own is written pkg/msg/Name."
        if near
        else "a type of your own is written pkg/msg/Name",
    )


def _check_clashes(answers: Answers) -> tuple[Problem, ...]:
    """Two classes of one name cannot both be in the node's module."""
    twice = tuple(
        Problem(
            sentence=f"`{one.full}` and `{other.full}` have the same class name `{one.name}`",
            help="choose message types whose last names differ",
        )
        for one, other in combinations(answers.messages, 2)
        if one.name == other.name and one != other
    )
    own = {answers.class_name, *_CLASSES_IN_USE}
    return twice + tuple(
        Problem(
            sentence=f"`{message.full}` has the name of a class that the node's module needs",
            help="choose another name for the node, or another message type",
        )
        for message in answers.messages
        if message.name in own
    )
