"""An active stack: crashes, hangs and requested changes, in a fake world."""

import signal
from collections import deque
from functools import partial

import pytest

from obk_cli.launch.events import (
    Answered,
    AnswersAgain,
    ChangeRequested,
    Evidence,
    Failed,
    GoesOnWithout,
    Hung,
    Phase,
    ProcessEnded,
    Restarted,
    Restarting,
    StackStateChanged,
    StateAnswered,
    StateSeen,
    StatusRequested,
    StopRequested,
    TransitionEnded,
    TransitionStarted,
    WaitingFor,
)
from obk_cli.plan.plan import Plan
from obk_cli.runs.protocol import ChangeAnswer, StackStatus

from .world import CONTROLLER, ESTIMATOR, ROBOT, World, process

STOP = StopRequested(reason="SIGINT")


def died(name: str = ROBOT) -> ProcessEnded:
    return ProcessEnded(process=name, code=-11)


def test_a_restarted_process_returns_to_the_stacks_state() -> None:
    world = World(on_crash="restart", later=deque([died(), 1.0, STOP]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    assert world.started.count(ROBOT) == 2
    assert world.transitions_of(ROBOT)[:4] == ["configure", "activate", "configure", "activate"]
    assert world.transitions_of(CONTROLLER)[:3] == ["configure", "activate", "deactivate"]
    assert world.of(Restarting) == [Restarting(nodes=(ROBOT,), wait_s=0.1, attempt=1, attempts=5)]
    assert world.of(Restarted) == [Restarted(nodes=(ROBOT,))]
    states = [
        event.state for event in world.of(StackStateChanged) if isinstance(event, StackStateChanged)
    ]
    assert states[states.index("active") :][:4] == ["active", "unconfigured", "inactive", "active"]


def test_restarts_wait_longer_each_time_and_end_when_the_budget_is_spent() -> None:
    world = World(on_crash="restart", dies_at_start={}, later=deque([died()]))
    world.dies_at_start[ROBOT] = 0
    world.later.appendleft(lambda: world.dies_at_start.update({ROBOT: 99}))
    ended = world.run(duration_s=None)
    waits = [event.wait_s for event in world.of(Restarting) if isinstance(event, Restarting)]
    assert waits == [0.1, 0.2, 0.4, 0.8, 1.6]
    assert ended.exit_code == 1
    assert ended.cause.startswith("6 crashes within 30 s; the last one: /obelisk_robot_0: ")
    assert ended.origin == "c.yaml:1:1"


def test_an_ignored_node_is_reported_and_left_out_of_the_stack() -> None:
    answers: list[ChangeAnswer] = []
    ask = ChangeRequested(transition="deactivate", reply=answers.append)
    world = World(on_crash="ignore", later=deque([died(CONTROLLER), ask, STOP]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    assert world.of(GoesOnWithout) == [GoesOnWithout(nodes=(CONTROLLER,))]
    assert answers[0].success
    assert [m.node for m in answers[0].members] == [ESTIMATOR, ROBOT]


def test_a_node_that_fails_by_itself_recovers_without_a_new_process() -> None:
    failed = Failed(node=ESTIMATOR, fault="compute_state_estimate: boom")
    world = World(on_crash="restart", later=deque([failed, 1.0, STOP]))
    assert world.run(duration_s=None).exit_code == 0
    assert world.started.count(ESTIMATOR) == 1
    assert world.transitions_of(ESTIMATOR)[2:4] == ["configure", "activate"]


def test_a_crash_during_the_bring_up_is_recovered() -> None:
    world = World(on_crash="restart", dies_at_start={ESTIMATOR: 2})
    ended = world.run()
    assert ended.exit_code == 0
    assert world.started.count(ESTIMATOR) == 3
    assert "active" in world.phases


class FaultyWorld(World):
    """The controller, which is inactive, fails when the robot is activated for the first time."""

    def request(self, node: str, transition: str) -> None:
        is_first = (ROBOT, "activate") not in self.done
        if (node, transition) == (ROBOT, "activate") and is_first:
            self.states[CONTROLLER] = "unconfigured"
            self.inbox.append(Failed(node=CONTROLLER, fault="on_state: boom"))
        if (node, transition) == (CONTROLLER, "activate") and self.states[node] == "unconfigured":
            self.done.append((node, transition))
            self.inbox.append(Answered(node=node, transition=transition, success=False, fault=""))
        else:
            super().request(node, transition)


def test_a_fault_of_an_inactive_node_during_the_bring_up_is_recovered() -> None:
    world = FaultyWorld(on_crash="restart")
    assert world.run().exit_code == 0
    assert world.started.count(CONTROLLER) == 1
    assert world.transitions_of(CONTROLLER)[:4] == [
        "configure",
        "activate",
        "configure",
        "activate",
    ]
    assert "active" in world.phases


def test_a_node_that_fails_during_the_bring_up_may_be_ignored() -> None:
    world = FaultyWorld(on_crash="ignore")
    assert world.run().exit_code == 0
    assert world.of(GoesOnWithout) == [GoesOnWithout(nodes=(CONTROLLER,))]


def test_a_node_that_fails_during_the_bring_up_stops_the_stack_by_default() -> None:
    ended = FaultyWorld().run()
    assert ended.exit_code == 1
    assert ended.cause == f"{CONTROLLER} failed: on_state: boom"


def test_a_node_that_fails_again_after_its_restart_uses_up_its_budget() -> None:
    world = World(on_crash="restart", later=deque([died()]))
    world.later.appendleft(lambda: world.refuses.update({(ROBOT, "configure"): "no gain"}))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 1
    assert "the transition `configure` failed after a restart" in ended.cause


def test_a_hang_is_detected_within_two_seconds_and_stops_the_stack() -> None:
    world = World()
    world.later.extend([lambda: world.mute.add(CONTROLLER), 10.0])
    ended = world.run(duration_s=None)
    assert ended.cause == f"{CONTROLLER} hangs: no answer for 1.8 s"
    assert world.of(Hung) == [Hung(node=CONTROLLER, seconds=pytest.approx(1.8))]
    assert world.of(Evidence) == [
        Evidence(node=CONTROLLER, lines=(f"the last line of {CONTROLLER}",))
    ]
    assert world.dumped == [CONTROLLER]
    assert next(n for name, n in world.signals if name == CONTROLLER) == signal.SIGKILL


def test_a_hanging_node_is_killed_and_restarted_if_its_rule_requires() -> None:
    world = World(on_crash="restart")
    hang = [lambda: world.mute.add(ROBOT), 3.0, lambda: world.mute.discard(ROBOT), 3.0, STOP]
    world.later.extend(hang)
    assert world.run(duration_s=None).exit_code == 0
    assert world.started.count(ROBOT) == 2
    assert world.of(Restarted) == [Restarted(nodes=(ROBOT,))]


def test_a_hanging_node_that_is_ignored_may_answer_again() -> None:
    world = World(on_crash="ignore")
    world.later.extend(
        [lambda: world.mute.add(ROBOT), 5.0, lambda: world.mute.discard(ROBOT), 3.0, STOP]
    )
    assert world.run(duration_s=None).exit_code == 0
    assert len(world.of(Hung)) == 1
    assert world.of(AnswersAgain) == [AnswersAgain(node=ROBOT)]


def test_a_short_silence_is_no_hang() -> None:
    world = World()
    world.later.extend(
        [lambda: world.mute.add(ROBOT), 1.0, lambda: world.mute.discard(ROBOT), 5.0, STOP]
    )
    assert world.run(duration_s=None).exit_code == 0
    assert not world.of(Hung)


def answered(node: str, transition: str) -> Answered:
    return Answered(node=node, transition=transition, success=True, fault="")


def test_a_robot_that_hangs_while_other_nodes_are_activated_is_detected_at_once() -> None:
    world = World(silent={(ESTIMATOR, "activate")})
    world.later.extend([lambda: world.mute.add(ROBOT), 9.0])
    ended = world.run()
    assert [event.node for event in world.of(Hung) if isinstance(event, Hung)] == [ROBOT]
    assert ended.cause.startswith(f"{ROBOT} hangs")
    assert "activate" not in world.transitions_of(CONTROLLER)


def test_a_slow_reply_while_other_nodes_are_activated_is_no_hang() -> None:
    world = World(silent={(ESTIMATOR, "activate")})
    thaw = partial(world.mute.discard, ROBOT)
    world.later.extend([lambda: world.mute.add(ROBOT), 2.0, thaw, answered(ESTIMATOR, "activate")])
    assert world.run().exit_code == 0
    assert not world.of(Hung)


def test_a_node_may_be_silent_for_the_time_limit_of_its_activation() -> None:
    world = World(silent={(ESTIMATOR, "activate")})
    silence = [
        lambda: world.mute.add(ESTIMATOR),
        8.0,
        lambda: world.mute.discard(ESTIMATOR),
        answered(ESTIMATOR, "activate"),
    ]
    world.later.extend(silence)
    assert world.run().exit_code == 0
    assert not world.of(Hung)


def test_a_transition_may_block_the_other_nodes_of_its_process() -> None:
    all_nodes = {CONTROLLER, ESTIMATOR, ROBOT}
    for transition in ("activate", "deactivate"):
        world = World(
            together=frozenset(all_nodes), silent={(CONTROLLER, transition)}, mute=set(all_nodes)
        )
        if transition == "deactivate":
            world.mute.clear()
            change = ChangeRequested(
                transition=transition, nodes=(CONTROLLER,), reply=lambda _: None
            )
            world.later.extend([1.0, change, partial(world.mute.update, all_nodes)])
        thaw = partial(world.mute.difference_update, all_nodes)
        answer = answered(CONTROLLER, transition)
        world.later.extend([8.0, thaw, world.silent.clear, answer, 3.0, STOP])
        assert world.run(duration_s=None).exit_code == 0
        assert not world.of(Hung)


def test_a_reply_that_is_older_than_the_request_does_not_end_its_time_limit() -> None:
    world = World(silent={(CONTROLLER, "deactivate")})
    change = ChangeRequested(transition="deactivate", nodes=(CONTROLLER,), reply=lambda _: None)
    silence = [
        lambda: world.mute.add(CONTROLLER),
        change,
        StateAnswered(node=CONTROLLER, state="active"),
        8.0,
        world.mute.clear,
        world.silent.clear,
        answered(CONTROLLER, "deactivate"),
        3.0,
        STOP,
    ]
    world.later.extend(silence)
    assert world.run(duration_s=None).exit_code == 0
    assert not world.of(Hung)


def test_error_processing_belongs_to_a_transition_that_was_not_requested_here() -> None:
    world = World()
    silence = [
        lambda: world.mute.add(CONTROLLER),
        TransitionStarted(node=CONTROLLER, transition="deactivate"),
        Failed(node=CONTROLLER, fault="on_deactivate: ValueError", transition="deactivate"),
        8.0,
        world.mute.clear,
        StateSeen(node=CONTROLLER, state="unconfigured", transition=""),
        3.0,
        STOP,
    ]
    world.later.extend(silence)
    assert world.run(duration_s=None).exit_code == 0
    assert not world.of(Hung)


def test_a_hang_is_detected_soon_after_a_transition() -> None:
    world = World(together=frozenset({CONTROLLER, ROBOT}))
    change = ChangeRequested(transition="deactivate", nodes=(CONTROLLER,), reply=lambda _: None)
    world.later.extend([change, 1.0, partial(world.mute.update, {CONTROLLER, ROBOT}), 3.0, STOP])
    assert world.run(duration_s=None).exit_code == 1
    assert world.of(Hung)


def test_a_hang_of_a_shared_process_is_attributed_to_the_process() -> None:
    world = World(together=frozenset({CONTROLLER, ESTIMATOR, ROBOT}))
    hang_together(world, for_s=10.0)
    ended = world.run(duration_s=None)
    assert ended.cause.startswith("/s/composed hangs")
    assert (ended.origin, ended.consequences) == ("", 0)


def test_a_transition_without_a_response_shows_where_the_node_is_stuck() -> None:
    world = World(silent={(ROBOT, "configure")})
    world.run()
    assert world.dumped == [ROBOT]
    assert world.of(Evidence) == [Evidence(node=ROBOT, lines=(f"the last line of {ROBOT}",))]


def ask(world: World, transition: str, *nodes: str) -> ChangeAnswer:
    """Request a change of an active stack, then stop it."""
    answers: list[ChangeAnswer] = []
    world.later.extend(
        [ChangeRequested(transition=transition, nodes=nodes, reply=answers.append), 0.1, STOP]
    )
    world.run(duration_s=None)
    (answer,) = answers
    return answer


class Talkative(World):
    """Processes with a long output and long stack dumps."""

    output: tuple[str, ...] = tuple(f"line {n}" for n in range(60))

    def dump_stack(self, process: str) -> None:
        self.output = (*self.output, *(f"frame {n}" for n in range(25)))[-60:]

    def last_lines(self, process: str) -> tuple[str, ...]:
        return self.output


def test_a_long_stack_dump_keeps_the_nodes_earlier_output() -> None:
    world = Talkative(silent={(ROBOT, "configure")})
    assert world.run().exit_code == 1
    evidence = world.of(Evidence)[0]
    assert isinstance(evidence, Evidence)
    assert evidence.lines[:20] == tuple(f"line {n}" for n in range(40, 60))
    assert evidence.lines[20:] == tuple(f"frame {n}" for n in range(25))


def test_the_whole_stack_is_taken_through_a_transition() -> None:
    world = World()
    answer = ask(world, "deactivate")
    assert answer.success
    assert [(m.node, m.result, m.state) for m in answer.members] == [
        (node, "reached", "inactive") for node in (CONTROLLER, ESTIMATOR, ROBOT)
    ]
    states = [
        event.state for event in world.of(StackStateChanged) if isinstance(event, StackStateChanged)
    ]
    assert "deactivating" in states
    assert states[states.index("deactivating") + 1] == "inactive"


def test_one_node_alone_takes_the_stack_down_to_its_state() -> None:
    world = World()
    assert ask(world, "deactivate", CONTROLLER).success
    assert world.transitions_of(ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]
    assert StackStateChanged(state="inactive") in world.published


def test_a_failed_change_is_taken_back_and_leaves_the_stack_up() -> None:
    world = World(refuses={(ROBOT, "deactivate"): "on_deactivate: no"})
    answer = ask(world, "deactivate")
    assert not answer.success
    assert answer.why == f"{ROBOT}: the transition `deactivate` failed: on_deactivate: no"
    assert [(m.node, m.result, m.state) for m in answer.members] == [
        (CONTROLLER, "rolled back", "active"),
        (ESTIMATOR, "rolled back", "active"),
        (ROBOT, "refused", "active"),
    ]
    assert StackStateChanged(state="active") in world.published


def test_an_invalid_change_is_rejected_as_a_whole() -> None:
    world = World()
    answer = ask(world, "cleanup")
    assert answer.why == f"`cleanup` requires inactive, but {CONTROLLER} is active"
    assert not answer.members
    assert "rolled back" not in world.phases


def test_a_node_that_is_not_there_is_named() -> None:
    assert ask(World(), "deactivate", "/nobody").why == (
        "not lifecycle nodes of this launch: /nobody"
    )


def test_a_shutdown_of_all_ends_the_run_cleanly() -> None:
    world = World()
    answers: list[ChangeAnswer] = []
    world.later.append(ChangeRequested(transition="shutdown", reply=answers.append))
    assert world.run(duration_s=None).exit_code == 0
    assert answers[0].success


def test_a_change_requested_during_another_one_is_rejected() -> None:
    answers: list[ChangeAnswer] = []
    world = World(silent={(ROBOT, "configure")})
    world.later.append(ChangeRequested(transition="activate", reply=answers.append))
    world.run()
    assert answers == [ChangeAnswer(success=False, why="the stack is being brought up")]


def test_the_status_of_the_stack_can_be_requested_at_any_time() -> None:
    seen: list[StackStatus] = []
    world = World(silent={(ROBOT, "configure")})
    world.later.append(StatusRequested(reply=seen.append))
    world.run()
    assert seen[0].state == "configuring"
    assert seen[0].nodes[2].node == ROBOT
    assert seen[0].nodes[2].pid == 1


def test_nodes_that_share_a_process_are_started_and_ended_as_one() -> None:
    both = frozenset({CONTROLLER, ESTIMATOR})
    world = World(together=both)
    assert world.run().exit_code == 0
    assert world.started == ["/s/composed", ROBOT]
    assert world.signals.count(("/s/composed", signal.SIGINT)) == 1
    assert world.transitions_of(CONTROLLER)[:2] == ["configure", "activate"]


def test_a_crash_of_a_shared_process_restarts_all_of_its_nodes() -> None:
    world = World(
        on_crash="restart",
        together=frozenset({CONTROLLER, ESTIMATOR}),
        later=deque([died("/s/composed"), 2.0, STOP]),
    )
    assert world.run(duration_s=None).exit_code == 0
    assert world.transitions_of(CONTROLLER)[2:4] == ["configure", "activate"]
    assert world.transitions_of(ESTIMATOR)[2:4] == ["configure", "activate"]


def hang_together(world: World, *, for_s: float) -> None:
    nodes = {CONTROLLER, ESTIMATOR, ROBOT}
    freeze, thaw = partial(world.mute.update, nodes), partial(world.mute.difference_update, nodes)
    world.later.extend([freeze, for_s, thaw, 3.0, STOP])


def test_a_hang_is_handled_even_without_other_events() -> None:
    world = World()
    hang_together(world, for_s=1000.0)
    ended = world.run(duration_s=None)
    assert ended.exit_code == 1
    assert "hangs: no answer for 1.8 s" in ended.cause
    assert world.now < 20


def test_nodes_that_hang_in_one_process_restart_it_once() -> None:
    world = World(on_crash="restart", together=frozenset({CONTROLLER, ESTIMATOR, ROBOT}))
    hang_together(world, for_s=3.0)
    assert world.run(duration_s=None).exit_code == 0
    assert len(world.of(Hung)) == 3
    assert world.started == ["/s/composed", "/s/composed"]
    assert len(world.of(Restarted)) == 1


def test_nodes_that_hang_in_one_process_are_dropped_together() -> None:
    world = World(on_crash="ignore", together=frozenset({CONTROLLER, ESTIMATOR, ROBOT}))
    hang_together(world, for_s=3.0)
    assert world.run(duration_s=None).exit_code == 0
    assert len(world.of(GoesOnWithout)) == 1
    assert len(world.of(AnswersAgain)) == 3


TWO = Plan(name="s", nodes=(process("control", device="offboard"), process("robot")))


def test_a_lead_waits_for_other_devices_and_takes_their_nodes_along() -> None:
    world = World(plan=TWO, devices=frozenset({"offboard"}), never_ready={ROBOT})

    def arrives() -> None:
        world.never_ready.clear()
        world.watch([ROBOT])

    world.later.extend([12.0, arrives])
    assert world.run().exit_code == 0
    assert world.of(WaitingFor)[0] == WaitingFor(devices=("onboard",), nodes=(ROBOT,))
    assert len(world.of(WaitingFor)) == 3
    assert world.started == [CONTROLLER]
    assert world.done[:2] == [(ROBOT, "configure"), (CONTROLLER, "configure")]
    assert (ROBOT, signal.SIGINT) not in world.signals


def test_a_node_of_another_device_is_not_waited_for_longer_than_its_restarts_may_take() -> None:
    world = World(plan=TWO, devices=frozenset({"offboard"}), on_crash="restart")
    world.later.extend([lambda: world.mute.add(ROBOT), 60.0])
    ended = world.run(duration_s=None)
    assert ended.exit_code == 1
    assert ended.cause.startswith(f"{ROBOT} has not answered for 3")
    assert ended.cause.endswith(" s, and the launch on its device has not restarted it")
    assert world.now < 45.0


def test_a_follower_makes_no_transitions_until_the_end() -> None:
    world = World(plan=TWO, lead="/s", later=deque([5.0, STOP]))
    assert world.run(duration_s=None).exit_code == 0
    assert world.started == [ROBOT]
    assert world.done == [(ROBOT, "shutdown")]
    assert Phase(name="following", seconds=0.0, detail="/s") in world.published


def test_a_follower_ends_when_its_nodes_were_shut_down() -> None:
    seen = StateSeen(node=ROBOT, state="finalized", transition="shutdown")
    world = World(plan=TWO, lead="/s", later=deque([seen]))
    assert world.run(duration_s=None).exit_code == 0


def test_a_follower_does_not_outlive_its_lead() -> None:
    world = World(plan=TWO, lead="/s")
    world.later.extend([3.0, lambda: world.mute.add("/s"), 10.0])
    ended = world.run(duration_s=None)
    assert ended.cause.startswith("the lead /s has not answered for ")


def test_an_external_transition_also_changes_the_target_of_a_restart() -> None:
    seen = StateSeen(node=ROBOT, state="inactive", transition="deactivate")
    world = World(on_crash="restart", later=deque([seen, died(), 1.0, STOP]))
    world.run(duration_s=None)
    assert world.transitions_of(ROBOT)[2:4] == ["configure", "cleanup"]
    assert not [e for e in world.of(TransitionEnded) if e.result == "timed out"]  # type: ignore[union-attr]
