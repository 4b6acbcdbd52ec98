"""A launch file for `ros2 launch`: plain launch_ros, for people on a full ROS 2.

One file that needs no other: it carries the text that `--to params` writes, and puts it beside the
launch's own logs. Handing launch_ros the values themselves would not do: it reads every text as
YAML, and settings are YAML.

Source: https://docs.ros.org/en/jazzy/p/launch_ros/
"""

import re
from collections.abc import Iterator

from obk_cli.emit.params import emit_params
from obk_cli.plan.plan import Plan, PlannedNode

__all__ = ["emit_launch_file"]

_HEAD = '''\
"""Starts the nodes of a stack, configures them, and activates them tier by tier.

Written by `obk compile --to launch`. Change the config and compile it again, not this file.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import EmitEvent, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.events import matches_action
from launch.logging import launch_config
from launch_ros.actions import LifecycleNode%s
from launch_ros.event_handlers import OnStateTransition
from launch_ros.events.lifecycle import ChangeState
from lifecycle_msgs.msg import Transition

# State before, transition, state on the way, state after.
CONFIGURE = ("unconfigured", Transition.TRANSITION_CONFIGURE, "configuring", "inactive")
ACTIVATE = ("inactive", Transition.TRANSITION_ACTIVATE, "activating", "active")

'''

_TAIL = '''

def parameter_file():
    """All nodes' parameters, in a file beside the logs of this launch."""
    path = Path(launch_config.log_dir, PARAMETER_FILE)
    path.write_text(PARAMETERS, encoding="utf-8")
    return str(path)


def bring_up(tiers):
    """Event handlers that take all tiers to active, and the requests that set them going."""
    # All tiers configure, the robot first, before the first one activates.
    steps = [(CONFIGURE, tier) for tier in tiers] + [(ACTIVATE, tier) for tier in tiers]
    handlers = []
    requests = []
    for change, nodes in reversed(steps):
        handlers += step_handlers(change, nodes, then=requests)
        requests = [request(change, node) for node in nodes]
    return handlers + requests


def request(change, node):
    """Asks a node for a transition."""
    _, transition, _, _ = change
    return EmitEvent(
        event=ChangeState(lifecycle_node_matcher=matches_action(node), transition_id=transition)
    )


def step_handlers(change, nodes, then):
    """Event handlers that do `then` once all nodes have changed, and shut down if one cannot."""
    before, _, on_the_way, after = change
    waiting = set(nodes)

    def changed(_context, node):
        if node not in waiting:
            return []
        waiting.remove(node)
        return [] if waiting else then

    def failed(_context, node):
        # Only during bring-up: later transitions are requested by a user.
        why = f"{node.node_name} did not become {after}"
        return [Shutdown(reason=why)] if node in waiting else []

    for node in nodes:
        for goal, react in ((after, changed), (before, failed), ("errorprocessing", failed)):
            yield RegisterEventHandler(
                OnStateTransition(
                    target_lifecycle_node=node,
                    start_state=on_the_way,
                    goal_state=goal,
                    entities=[OpaqueFunction(function=react, args=[node])],
                )
            )
'''


def emit_launch_file(plan: Plan) -> str:
    """The text of the launch file."""
    has_others = any(not node.has_lifecycle for node in plan.nodes)
    name = re.sub(r"\W", "_", plan.name)
    # In a parameter file all text stands in double quotes, where a quote may go by its number.
    parameters = emit_params(plan.nodes).replace("'''", r"''\x27")
    return "".join(
        (
            _HEAD % (", Node" if has_others else ""),
            f"PARAMETER_FILE = {_text(f'{name}.params.yaml')}\n",
            f"PARAMETERS = r'''\n{parameters}'''\n",
            *(f"{line}\n" for line in _description(plan)),
            _TAIL,
        )
    )


def _description(plan: Plan) -> Iterator[str]:
    """The function that `ros2 launch` calls, with every node written out."""
    yield from ("", "", "def generate_launch_description():", "    parameters = parameter_file()")
    names: list[str] = []
    others: list[str] = []
    for tier in plan.tiers:
        section = tier[0].section
        (names if tier[0].has_lifecycle else others).append(section)
        yield f"    {section} = ["
        for node in tier:
            yield from _node(node)
        yield "    ]"
    yield f"    nodes = [{', '.join(f'*{name}' for name in (*names, *others))}]"
    yield f"    return LaunchDescription([*nodes, *bring_up([{', '.join(names)}])])"


def _node(node: PlannedNode) -> Iterator[str]:
    yield f"        {'LifecycleNode' if node.has_lifecycle else 'Node'}("
    arguments = {
        "package": _text(node.package),
        "executable": _text(node.executable),
        "name": _text(node.node),
        "namespace": _text(node.namespace),
        "parameters": "[parameters]",
    }
    if node.remappings:
        pairs = (f"({_text(source)}, {_text(target)})" for source, target in node.remappings)
        arguments["remappings"] = f"[{', '.join(pairs)}]"
    if node.log_level:
        arguments["ros_arguments"] = f'["--log-level", {_text(node.log_level)}]'
    if node.env:
        pairs = (f"{_text(name)}: {_text(value)}" for name, value in node.env.items())
        arguments["additional_env"] = f"{{{', '.join(pairs)}}}"
    arguments["output"] = '"screen"'
    arguments["on_exit"] = f"Shutdown(reason={_text(f'{node.full_name} ended')})"
    yield from (f"            {name}={value}," for name, value in arguments.items())
    yield "        ),"


def _text(text: str) -> str:
    """A Python literal, in double quotes where that takes no thought."""
    literal = repr(text)
    return f'"{text}"' if literal == f"'{text}'" and '"' not in text else literal
