"""All that a template may use, made from the answers.

In: checked answers. Out: names and values for jinja. Never touches the disk.
"""

from obk_cli.scaffold.cpp import cpp_control, cpp_estimate, cpp_header, cpp_type
from obk_cli.scaffold.fields import (
    control_filling,
    estimate_filling,
    is_position_control,
    reading_filling,
)
from obk_cli.scaffold.imports import LINE_LENGTH, import_block, message_imports
from obk_cli.scaffold.kinds import NODE_KINDS, SECTIONS
from obk_cli.scaffold.questions import Answers
from obk_cli.scaffold.snippet import TOPICS_TO_FILL_IN, config_snippet

__all__ = ["dependencies", "entry_point", "template_variables"]

_BASES = {
    "controller": ("obelisk_py.core.control", "ObeliskController"),
    "estimator": ("obelisk_py.core.estimation", "ObeliskEstimator"),
    "robot": ("obelisk_py.core.robot", "ObeliskRobot"),
    "sensor": ("obelisk_py.core.sensing", "ObeliskSensor"),
}
_LIFECYCLE = "rclpy.lifecycle"


def template_variables(answers: Answers, topics: str = TOPICS_TO_FILL_IN) -> dict[str, object]:
    """The variables of a node's package, or of a message package."""
    common: dict[str, object] = {
        "kind": answers.kind,
        "package": answers.package,
        "node": answers.node,
        "with_service": answers.with_service,
        "ctrl": answers.ctrl,
        "est": answers.est,
        "sensor": answers.sensor,
    }
    if answers.kind not in NODE_KINDS:
        return common
    return common | _node_variables(answers, topics) | _import_variables(answers)


def dependencies(answers: Answers) -> tuple[str, ...]:
    """The ROS packages that the node needs, sorted."""
    client = "rclpy" if answers.language == "py" else "rclcpp"
    return tuple(sorted({client, *(message.package for message in answers.messages)}))


def entry_point(answers: Answers) -> str:
    """The console script that runs the node."""
    return f"{answers.node} = {answers.package}.{answers.node}:main"


def _node_variables(answers: Answers, topics: str) -> dict[str, object]:
    follows = answers.kind == "robot" and is_position_control(answers.ctrl)
    positions = "self.positions" if answers.kind == "robot" else "[math.sin(self.t)]"
    return {
        "class_name": answers.class_name,
        "description": f"The Obelisk {answers.kind} {answers.node}.",
        "entry_point": entry_point(answers),
        "entry_point_noqa": _noqa(entry_point(answers)),
        "section": SECTIONS[answers.kind],
        "config_snippet": config_snippet(answers, topics),
        "control": control_filling(answers.ctrl, answers.controls),
        "estimate": estimate_filling(answers.est, answers.sensor),
        "reading": reading_filling(answers.sensor, positions),
        "follows_positions": follows,
        "dependencies": dependencies(answers),
        "cpp_types": {
            "ctrl": cpp_type(answers.ctrl),
            "est": cpp_type(answers.est),
            "sensor": cpp_type(answers.sensor),
        },
        "cpp_headers": tuple(sorted({cpp_header(message) for message in answers.messages})),
        "cpp_control": cpp_control(answers.ctrl, answers.controls),
        "cpp_estimate": cpp_estimate(answers.est, answers.sensor),
    }


def _import_variables(answers: Answers) -> dict[str, object]:
    messages = message_imports(answers.messages)
    node = (
        *messages,
        _BASES[answers.kind],
        ("obelisk_py.core.utils.ros", "spin_obelisk"),
        (_LIFECYCLE, "LifecycleState"),
        (_LIFECYCLE, "TransitionCallbackReturn"),
    )
    if answers.kind == "sensor":
        node = tuple(name for name in node if name[0] != _LIFECYCLE)
    own = (f"{answers.package}.{answers.node}", answers.class_name)
    test = import_block((*messages, (_LIFECYCLE, "TransitionCallbackReturn")))
    return {
        "node_imports": import_block(node),
        "test_imports": f"import pytest\nimport rclpy\n{test}\n\n{import_block([own])}",
    }


def _noqa(script: str) -> str:
    """A string in setup.py cannot be wrapped: long names leave the line too long."""
    indent_and_quotes = 15
    return "  # noqa: E501" if len(script) + indent_and_quotes > LINE_LENGTH else ""
