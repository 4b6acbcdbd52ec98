"""Scenarios of actions in lockstep, printed as JSON; a program, as it needs a built package."""

import json
from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future
from user_msgs.action import Walk

from obelisk_py.core.lockstep.scheduler import LockstepError, TimingModel

from .world import World, lockstep_process, seconds

STEP_S = 0.1


class Walker:
    """An action server that walks a meter in 0.1 s, and a client that records what it receives."""

    def __init__(self, **options: Any) -> None:
        self.world = World(**options)
        self.server_node, self.node = self.world.node("server"), self.world.node("client")
        self.seen: list[Any] = []
        self.server = self.serve()
        with self.world.lockstep.entered():
            self.client = ActionClient(self.node, Walk, "/walk")

    def serve(self) -> ActionServer:
        with self.world.lockstep.entered():
            return ActionServer(
                self.server_node,
                Walk,
                "/walk",
                self.execute,
                goal_callback=self.judge,
                cancel_callback=lambda _: CancelResponse.ACCEPT,
            )

    def judge(self, goal: Any) -> Any:
        return GoalResponse.REJECT if goal.distance < 0 else GoalResponse.ACCEPT

    async def execute(self, handle: Any) -> Any:
        if handle.request.distance > 100:
            raise ValueError("too far")
        walked = 0.0
        while walked < handle.request.distance and not handle.is_cancel_requested:
            await self.pause()
            walked += 1.0
            handle.publish_feedback(Walk.Feedback(walked=walked))
        if handle.is_cancel_requested:
            handle.canceled()
            return Walk.Result(done=False)
        handle.succeed()
        return Walk.Result(done=True)

    async def pause(self) -> None:
        future = Future()
        timer = self.server_node.create_timer(STEP_S, lambda: future.set_result(None))
        await future
        self.server_node.destroy_timer(timer)

    def note(self, what: Any) -> None:
        self.seen.append([seconds(self.node), what])

    async def walk(self, distance: float, cancel_after: int = 1000) -> None:
        handles: list[Any] = []
        steps: list[float] = []

        def feedback(message: Any) -> None:
            steps.append(message.feedback.walked)
            self.note(steps[-1])
            if len(steps) == cancel_after:
                handles[0].cancel_goal_async()

        goal = Walk.Goal(distance=distance)
        handle = await self.client.send_goal_async(goal, feedback_callback=feedback)
        handles.append(handle)
        self.note("accepted" if handle.accepted else "rejected")
        if handle.accepted:
            answer = await handle.get_result_async()
            self.note([answer.status, answer.result.done])

    def end(self) -> Any:
        notes = list(self.world.notes)
        self.client.destroy()
        self.server.destroy()
        self.world.close()
        return {"seen": self.seen, "notes": notes}


def goal() -> Any:
    walker = Walker()
    walker.world.at(walker.node, 0.5, lambda: walker.walk(2.0))
    walker.world.run(2.0)
    return walker.end()


def latency() -> Any:
    walker = Walker(timing=TimingModel(latency=0.01))
    walker.world.at(walker.node, 0.5, lambda: walker.walk(1.0))
    walker.world.run(2.0)
    return walker.end()


def rejected() -> Any:
    walker = Walker()
    walker.world.at(walker.node, 0.5, lambda: walker.walk(-1.0))
    walker.world.run(1.0)
    return walker.end()


def canceled() -> Any:
    walker = Walker()
    walker.world.at(walker.node, 0.5, lambda: walker.walk(9.0, cancel_after=2))
    walker.world.run(2.0)
    return walker.end()


def raises() -> Any:
    walker = Walker()
    walker.world.at(walker.node, 0.5, lambda: walker.walk(101.0))
    walker.world.run(1.0)
    return walker.end()


def no_server() -> Any:
    walker = Walker()
    walker.server.destroy()

    def wait() -> None:
        walker.note(walker.client.wait_for_server(timeout_sec=0.5))

    walker.world.at(walker.node, 0.5, wait)
    walker.world.run(0.9)
    walker.world.at(walker.node, 1.5, lambda: walker.walk(1.0))
    walker.world.run(1.0)
    walker.server = walker.serve()
    walker.world.at(walker.node, 2.0, lambda: walker.walk(1.0))
    walker.world.run(0.5)
    return walker.end()


def blocking() -> Any:
    walker = Walker()
    walker.world.at(walker.node, 0.5, lambda: walker.client.send_goal(Walk.Goal(distance=1.0)))
    try:
        walker.world.run(1.0)
    except LockstepError as error:
        walker.seen.append(str(error))
    return walker.end()


SCENARIOS: tuple[Callable[[], Any], ...] = (
    goal,
    latency,
    rejected,
    canceled,
    raises,
    no_server,
    blocking,
)

if __name__ == "__main__":
    with lockstep_process():
        print(json.dumps({scenario.__name__: scenario() for scenario in SCENARIOS}))
