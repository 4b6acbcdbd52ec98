"""The live table: keys, requests, the filter, the stack's end; with fake views."""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

import pytest
from textual.pilot import Pilot
from textual.widgets import Input, Static

from obelisk_spec.parameter_notes import ParameterNotes
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.tuning import ChangedParameter, TunableParameter
from obk_cli.monitor.app import HELP, MonitorApp
from obk_cli.monitor.model import StackView
from obk_cli.ros.parameters import (
    NodeParameter,
    ParameterDescription,
    fit_parameter,
    parse_parameter,
)
from obk_cli.runs.protocol import ChangeAnswer

from .stacks import BROKEN, HEALTHY

CONTROL = "/obelisk_control_0"
Steps = Callable[["World"], Awaitable[None]]


class Watch:
    """Returns the views that a test sets."""

    def __init__(self, *views: StackView | Exception | None) -> None:
        self._next: SimpleQueue[StackView | Exception | str | None] = SimpleQueue()
        for view in views:
            self._next.put(view)
        self.has_stopped = False

    def views(self) -> Iterator[StackView | None]:
        while not isinstance(view := self._next.get(), str):
            if isinstance(view, Exception):
                raise view
            yield view

    def put(self, view: StackView | None) -> None:
        self._next.put(view)

    def stop(self) -> None:
        self.has_stopped = True
        self._next.put("stop")


NOTES = {
    "kp": ParameterNotes(least=0.0, most=200.0, unit="N m/rad", is_live=True, initial=20.0),
    "is_on": ParameterNotes(is_live=True, initial=True),
    "steps": ParameterNotes(is_live=False, initial=3),
}
KINDS = {float: "double", bool: "bool", int: "integer"}


def tunable(name: str, value: Any) -> TunableParameter:
    kind = KINDS[type(value)]
    return TunableParameter(
        name=name,
        value=NodeParameter(kind=kind, value=value),
        description=ParameterDescription(kind=kind, notes=NOTES[name]),
    )


class World:
    """An app under test, and its requests."""

    def __init__(self, watch: Watch) -> None:
        self.watch = watch
        self.asked: list[tuple[str, tuple[str, ...]]] = []
        self.runs: list[str] = []
        self.answer = ChangeAnswer(success=True)
        self.error: Exception | None = None
        self.may_answer = threading.Event()
        self.may_answer.set()
        self.values: dict[str, Any] = {"kp": 20.0, "is_on": True, "steps": 3}
        self.app = MonitorApp(watch, self.change, self)
        self.pilot: Pilot[Exception | None]

    def change(self, view: StackView, verb: str, nodes: tuple[str, ...]) -> ChangeAnswer:
        self.may_answer.wait()
        self.asked.append((verb, nodes))
        self.runs.append(view.run)
        if self.error is not None:
            raise self.error
        if verb == "cleanup" and not self.answer.success:
            raise CommandFailedError("no answer", help="see `obk ps`")
        return self.answer

    def of(self, view: StackView) -> dict[str, tuple[TunableParameter, ...]]:
        assert view.nodes
        return {CONTROL: tuple(tunable(name, value) for name, value in self.values.items())}

    def set(self, view: StackView, node: str, name: str, text: str) -> ChangedParameter:
        assert (view.run, node) == (HEALTHY.run, CONTROL)
        before = tunable(name, self.values[name]).value
        after = fit_parameter(text, parse_parameter(text), before.kind)
        if name == "kp" and not 0.0 <= float(text) <= 200.0:
            raise CommandFailedError("too much")
        self.values[name] = after.value
        return ChangedParameter(name=name, before=before, after=after, unit="", effect="in effect")

    def text(self, part: str) -> str:
        return str(self.app.query_one(f"#{part}", Static).render())

    async def press(self, *keys: str) -> None:
        await self.pilot.press(*keys)

    async def shows(self, part: str, words: str) -> None:
        """Wait until a part of the screen shows this text."""
        async with asyncio.timeout(30):
            while words not in self.text(part):
                await self.pilot.pause(0.01)


def live(
    steps: Steps, *views: StackView | Exception | None, size: tuple[int, int] = (80, 24)
) -> World:
    world = World(Watch(*views))

    async def run() -> None:
        async with world.app.run_test(size=size) as pilot:
            world.pilot = pilot
            await steps(world)
        world.app.stop_following()

    asyncio.run(run())
    assert world.watch.has_stopped
    return world


def test_before_a_stack_runs_it_reports_that_and_then_shows_the_stack() -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "looking for a stack")
        await world.press("a")
        assert not world.text("message")
        world.watch.put(None)
        await world.shows("head", "no stack is running; waiting for one")
        await world.press("a")
        await world.shows("message", "nothing is running")
        world.watch.put(HEALTHY)
        await world.shows("head", "dummy  active  up 0:01:23")
        await world.shows("nodes_text", "estimation_0  active")
        await world.shows("topics_text", "age along the path")
        await world.shows("log_text", "[WARN] the simulation fell behind")
        assert not world.text("message")

    live(steps)


@pytest.mark.parametrize("size", [(80, 24), (40, 10), (20, 5)])
def test_parts_without_room_are_left_out_without_a_scrollbar(size: tuple[int, int]) -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        await world.pilot.pause()
        assert not any(world.app.screen.scrollbars_enabled)

    live(steps, HEALTHY, size=size)


def test_a_transition_of_the_stack_is_confirmed_before_it_is_executed() -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        await world.press("a")
        await world.shows("message", "activate all 3 nodes; the robot may move?  y / n")
        await world.press("n")
        assert world.text("message") == ""
        await world.press("y")
        await world.press("d")
        await world.shows("message", "deactivate all 3 nodes?  y / n")
        await world.press("y")
        await world.shows("message", "deactivate all nodes: done")

    assert live(steps, HEALTHY).asked == [("deactivate", ())]


def test_a_confirmation_applies_to_the_stack_of_the_question() -> None:
    other = replace(HEALTHY, run="arm_20310203_040507", name="arm")

    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        await world.press("a")
        await world.shows("message", "the robot may move?")
        world.watch.put(other)
        await world.shows("head", "arm")
        await world.press("y")
        await world.shows("message", "activate all nodes: done")

    assert live(steps, HEALTHY).runs == [HEALTHY.run]


def test_the_chosen_node_is_restarted_step_by_step() -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        await world.press("down", "r")
        await world.shows("message", "activate control_0; the robot may move?")
        await world.press("y")
        await world.shows("message", "activate control_0: done")

    verbs = ("deactivate", "cleanup", "configure", "activate")
    assert live(steps, HEALTHY).asked == [(verb, (CONTROL,)) for verb in verbs]


def test_a_failure_is_shown_with_its_cause_and_ends_the_rest() -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        world.answer = ChangeAnswer(success=False, why="/obelisk_control_0: no gains\nTraceback")
        await world.press("c", "y")
        await world.shows("message", "configure all nodes failed: /obelisk_control_0: no gains")
        assert "Traceback" not in world.text("message")
        await world.press("x", "y")
        await world.shows("message", "cleanup all nodes failed: no answer; see `obk ps`")

    assert [verb for verb, _ in live(steps, HEALTHY).asked] == ["configure", "cleanup"]


def test_during_a_transition_no_other_is_requested() -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        world.may_answer.clear()
        await world.press("d", "y")
        await world.shows("message", "deactivate all nodes ...")
        await world.press("a")
        await world.shows("message", "wait for the previous one to finish")
        await world.press("y")
        world.watch.put(replace(HEALTHY, name="still drawn"))
        await world.shows("head", "still drawn")
        world.may_answer.set()
        await world.shows("message", "deactivate all nodes: done")

    assert live(steps, HEALTHY).asked == [("deactivate", ())]


def test_the_log_is_filtered_while_the_filter_is_typed() -> None:
    async def steps(world: World) -> None:
        await world.shows("log_text", "simulation")
        await world.press("slash", *"GOAL")
        await world.shows("log_text", "no goal yet")
        assert "simulation" not in world.text("log_text")
        await world.press("enter", "d")
        await world.shows("keys", "[GOAL]")
        await world.shows("message", "deactivate")
        await world.press("escape", "escape")
        await world.shows("log_text", "simulation")
        assert not world.app.query_one("#filter", Input).display

    assert not live(steps, HEALTHY).asked


def test_help_replaces_topics_and_log_to_be_fully_visible() -> None:
    async def steps(world: World) -> None:
        await world.shows("log_text", "simulation")
        await world.press("question_mark")
        await world.shows("log_text", "quit; the stack keeps running")
        async with asyncio.timeout(30):
            while world.app.query_one("#log").size.height < len(HELP):
                await world.pilot.pause(0.01)
        await world.press("question_mark")
        await world.shows("log_text", "simulation")
        assert world.app.query_one("#topics").display

    live(steps, HEALTHY)


def test_a_stack_that_has_ended_stays_visible_until_another_starts() -> None:
    ended = replace(HEALTHY, state="", has_ended=True, cause="/a hangs", nodes=())

    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        await world.press("down")
        world.watch.put(ended)
        world.watch.put(None)
        await world.shows("head", "has stopped: /a hangs")
        await world.press("a")
        await world.shows("message", "nothing is running")
        world.watch.put(BROKEN)
        await world.shows("head", "2 topics off")

    live(steps, HEALTHY)


@pytest.mark.parametrize("size", [(80, 24), (160, 50), (40, 10)])
def test_the_selected_node_of_many_is_visible(size: tuple[int, int]) -> None:
    nodes = tuple(replace(HEALTHY.nodes[0], node=f"/obelisk_control_{n}") for n in range(60))

    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        world.app.action_move(60)
        pane = world.app.query_one("#nodes")
        async with asyncio.timeout(30):
            while pane.scroll_offset.y + pane.size.height < 62:
                await world.pilot.pause(0.01)
        world.app.action_move(-61)
        async with asyncio.timeout(30):
            while pane.scroll_offset.y:
                await world.pilot.pause(0.01)

    live(steps, replace(HEALTHY, nodes=nodes), size=size)


@pytest.mark.parametrize("key", ["q", "ctrl+c"])
def test_it_ends_by_its_keys(key: str) -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        await world.press(key)

    assert live(steps, HEALTHY).app.return_code == 0


@pytest.mark.parametrize("error", [CommandFailedError("ROS 2 is not here"), KeyError("a fault")])
def test_failures_of_monitoring_are_reported(error: Exception) -> None:
    async def steps(world: World) -> None:
        async with asyncio.timeout(30):
            while world.app.return_value is None:
                await world.pilot.pause(0.01)

    assert live(steps, error).app.return_value is error


def test_a_fault_of_the_tool_in_a_change_ends_the_table_with_it() -> None:
    error = KeyError("a fault")

    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        world.error = error
        await world.press("c", "y")
        async with asyncio.timeout(30):
            while world.app.return_value is None:
                await world.pilot.pause(0.01)

    assert live(steps, HEALTHY).app.return_value is error


def test_parameters_are_tuned_by_keys() -> None:
    async def steps(world: World) -> None:
        await world.shows("head", "dummy")
        await world.press("p")
        await world.shows("topics_text", "kp")
        await world.shows("keys", "r reset")
        await world.press("right")
        await world.shows("message", "kp changed from 20.0 to 22.0, in effect")
        await world.shows("topics_text", "was 20.0")
        await world.press("left")
        await world.shows("message", "kp changed from 22.0 to 20.0")
        await world.press("enter", *["backspace"] * 4, *"250", "enter")
        await world.shows("message", "too much")
        await world.press("enter", *["backspace"] * 4, *"50", "enter")
        await world.shows("message", "kp changed from 20.0 to 50.0")
        await world.press("r")
        await world.shows("message", "kp changed from 50.0 to 20.0")
        await world.press("down", "left")
        await world.shows("message", "is_on changed from true to false")
        await world.press("down", "right")  # without a range, there is no slider
        await world.press("enter", "escape", "escape")
        await world.shows("keys", "p parameters")
        assert world.values["steps"] == 3
        await world.press("r")
        await world.shows("message", "deactivate, cleanup")

    assert not live(steps, HEALTHY).asked
