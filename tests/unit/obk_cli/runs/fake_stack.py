"""A stack without processes: this process is its launcher, a thread its supervisor."""

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from queue import SimpleQueue

from obk_cli.launch.control_server import serve_control
from obk_cli.launch.events import ChangeRequested, InputEvent, StatusRequested, StopRequested
from obk_cli.launch.run_lock import claim_run
from obk_cli.process.identity import this_process
from obk_cli.runs.folder import Run, record_end
from obk_cli.runs.lifecycle import TRANSITIONS
from obk_cli.runs.protocol import ChangeAnswer, Member, NodeStatus, StackStatus
from obk_cli.runs.registry import section_of

NOW = datetime(2031, 2, 3, 4, 5, 6)
ROBOT, CONTROL, JOY = "/obelisk_robot_0", "/obelisk_control_0", "/joy"


class FakeStack:
    """The supervisor: changes states on request, unless a node is broken."""

    def __init__(self, folder: Path, run: Run, states: Mapping[str, str]) -> None:
        self.folder = folder
        self.run = run
        self.states = dict(states)
        self.broken: set[str] = set()
        self.hung: set[str] = set()
        self.received: list[InputEvent] = []

    def answer(self, received: InputEvent) -> None:
        self.received.append(received)
        match received:
            case StatusRequested():
                received.reply(self._status())
            case ChangeRequested():
                received.reply(self._changed(received))
            case StopRequested():
                record_end(self.folder, self.run, 1.0, exit_code=0)
            case _:
                return

    def _changed(self, asked: ChangeRequested) -> ChangeAnswer:
        goal = TRANSITIONS[asked.transition].goal
        members = []
        for node in asked.nodes or self.run.nodes:
            if node in self.broken:
                fault = f"on_{asked.transition}: no torque\nTraceback (most recent call last):"
                members.append(
                    Member(node=node, result="refused", state=self.states[node], fault=fault)
                )
                why = f"{node}: no torque"
                return ChangeAnswer(success=False, why=why, members=tuple(members))
            self.states[node] = goal
            members.append(Member(node=node, result="reached", state=goal))
        return ChangeAnswer(success=True, members=tuple(members))

    def _status(self) -> StackStatus:
        return StackStatus(
            name=self.run.name,
            state="active",
            phase="active",
            seconds=3723.0,
            nodes=tuple(self._node(name) for name in self.states),
        )

    def _node(self, name: str) -> NodeStatus:
        return NodeStatus(
            node=name,
            section=section_of(name) or "joystick",
            device="onboard",
            state=self.states[name],
            process=name,
            pid=1234 if name in self.run.all_nodes else None,
            restarts=2 if name == CONTROL else 0,
            hangs=name in self.hung,
        )


@contextmanager
def fake_stack(
    parent: Path,
    states: Mapping[str, str],
    *,
    name: str = "dummy",
    domain: int = 7,
    devices: tuple[str, ...] = (),
    leads: bool = True,
    elsewhere: Mapping[str, str] | None = None,
) -> Iterator[FakeStack]:
    """A stack that is running and replies; nodes without a state have no lifecycle.

    Args:
        parent: the folder of all runs.
        states: states of the nodes on this host.
        name: the name of the config.
        domain: the ROS domain.
        devices: the devices that run on this host.
        leads: whether this launcher controls the whole stack.
        elsewhere: states of other devices' nodes.
    """
    pid, started = this_process()
    run = Run(
        name=name,
        pid=pid,
        started=started,
        domain=domain,
        config=f"{name}.yaml",
        nodes=tuple(node for node, state in states.items() if state),
        other_nodes=tuple(node for node, state in states.items() if not state),
        devices=devices,
        leads=leads,
    )
    stack = FakeStack(claim_run(parent, run, NOW), run, {**states, **(elsewhere or {})})
    inbox: SimpleQueue[InputEvent | None] = SimpleQueue()

    def supervise() -> None:
        while (received := inbox.get()) is not None:
            stack.answer(received)

    thread = threading.Thread(target=supervise)
    thread.start()
    try:
        with serve_control(stack.folder, inbox.put):
            yield stack
    finally:
        inbox.put(None)
        thread.join()
        record_end(stack.folder, run, 1.0)
