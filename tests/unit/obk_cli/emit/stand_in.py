"""A fake `ros2 launch`: the modules that a launch file imports, and their effects.

All names, keywords and states are those of launch and launch_ros; unknown keywords are rejected.
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

__all__ = ["World", "run_launch_file"]

CONFIGURE, ACTIVATE = 1, 3
WAY = {
    CONFIGURE: ("unconfigured", "configuring", "inactive"),
    ACTIVATE: ("inactive", "activating", "active"),
}


@dataclass(kw_only=True, eq=False)
class Node:
    package: str
    executable: str
    name: str
    namespace: str
    parameters: list[str]
    output: str
    on_exit: "Shutdown"
    remappings: list[tuple[str, str]] = field(default_factory=list)
    ros_arguments: list[str] = field(default_factory=list)
    additional_env: dict[str, str] = field(default_factory=dict)

    @property
    def node_name(self) -> str:
        return f"{self.namespace.rstrip('/')}/{self.name}"


@dataclass(kw_only=True, eq=False)
class LifecycleNode(Node):
    state: str = field(default="unconfigured", init=False)


@dataclass
class LaunchDescription:
    entities: list[Any]


@dataclass(kw_only=True)
class EmitEvent:
    event: Any


@dataclass(kw_only=True)
class OpaqueFunction:
    function: Callable[..., list[Any] | None]
    args: list[Any]


@dataclass
class RegisterEventHandler:
    event_handler: "OnStateTransition"


@dataclass(kw_only=True)
class Shutdown:
    reason: str


@dataclass(kw_only=True)
class OnStateTransition:
    entities: list[Any]
    target_lifecycle_node: LifecycleNode
    start_state: str
    goal_state: str


@dataclass(kw_only=True)
class ChangeState:
    lifecycle_node_matcher: Callable[[Any], bool]
    transition_id: int


@dataclass
class World:
    """The outcome of a launch."""

    failing: dict[str, str] = field(default_factory=dict)
    """Node -> the state in which its transition towards `active` ends instead."""
    nodes: list[Node] = field(default_factory=list)
    handlers: list[OnStateTransition] = field(default_factory=list)
    events: list[ChangeState] = field(default_factory=list)
    states: list[tuple[str, str]] = field(default_factory=list)
    shutdown: str | None = None

    def visit(self, entity: Any) -> None:
        match entity:
            case Node():
                self.nodes.append(entity)
            case RegisterEventHandler():
                self.handlers.append(entity.event_handler)
            case EmitEvent():
                self.events.append(entity.event)
            case OpaqueFunction():
                for following in entity.function(self, *entity.args) or []:
                    self.visit(following)
            case Shutdown():
                self.shutdown = self.shutdown or entity.reason
            case _:
                raise TypeError(entity)

    def run(self) -> None:
        """Apply the effects of all events."""
        while self.events and self.shutdown is None:
            event = self.events.pop(0)
            for node in self.nodes:
                if isinstance(node, LifecycleNode) and event.lifecycle_node_matcher(node):
                    self.change(node, event.transition_id)

    def change(self, node: LifecycleNode, transition: int) -> None:
        before, on_the_way, after = WAY[transition]
        assert node.state == before, f"{node.node_name} is {node.state}"
        if transition == ACTIVATE:
            after = self.failing.get(node.node_name, after)
        node.state = after
        self.states.append((node.node_name, after))
        for handler in list(self.handlers):
            if handler.target_lifecycle_node is node and (
                (handler.start_state, handler.goal_state) == (on_the_way, after)
            ):
                for entity in handler.entities:
                    self.visit(entity)


def run_launch_file(
    text: str, log_folder: Path, monkeypatch: pytest.MonkeyPatch, **failing: str
) -> World:
    """Load a launch file as `ros2 launch` would, and execute it."""

    class Transition:
        TRANSITION_CONFIGURE = CONFIGURE
        TRANSITION_ACTIVATE = ACTIVATE

    class launch_config:  # noqa: N801  (the name that it has)
        log_dir = str(log_folder)

    def matches_action(action: Any) -> Callable[[Any], bool]:
        return lambda other: other is action

    offered: dict[str, dict[str, object]] = {
        "launch": {"LaunchDescription": LaunchDescription},
        "launch.actions": {
            "EmitEvent": EmitEvent,
            "OpaqueFunction": OpaqueFunction,
            "RegisterEventHandler": RegisterEventHandler,
            "Shutdown": Shutdown,
        },
        "launch.events": {"matches_action": matches_action},
        "launch.logging": {"launch_config": launch_config},
        "launch_ros": {},
        "launch_ros.actions": {"LifecycleNode": LifecycleNode, "Node": Node},
        "launch_ros.event_handlers": {"OnStateTransition": OnStateTransition},
        "launch_ros.events": {},
        "launch_ros.events.lifecycle": {"ChangeState": ChangeState},
        "lifecycle_msgs": {},
        "lifecycle_msgs.msg": {"Transition": Transition},
    }
    for name, members in offered.items():
        module = ModuleType(name)
        vars(module).update(members)
        monkeypatch.setitem(sys.modules, name, module)
    names: dict[str, Any] = {"__name__": "launch_file"}
    exec(compile(text, "arm.launch.py", "exec"), names)
    world = World(failing={f"/{name}": state for name, state in failing.items()})
    for entity in names["generate_launch_description"]().entities:
        world.visit(entity)
    world.run()
    return world
