"""The supervisor in a fake world: start, stop, and failures on the way."""

import signal
from collections import deque
from dataclasses import replace

import pytest

from obk_cli.launch.events import (
    UNKNOWN_FAULT,
    Answered,
    ChangeRequested,
    Ended,
    Failed,
    Hung,
    Phase,
    ProcessEnded,
    ProcessStarted,
    RejectionReported,
    Restarted,
    SignalIgnored,
    StackStateChanged,
    StateSeen,
    StopRequested,
    TransitionEnded,
    TransitionStarted,
)
from obk_cli.launch.process_groups import Unit
from obk_cli.plan.plan import OnCrash, Plan
from obk_cli.runs.protocol import ChangeAnswer

from .world import CONTROLLER, ESTIMATOR, PLAN, ROBOT, World, process


def test_a_stack_starts_robot_first_and_stops_controllers_first() -> None:
    world = World()
    ended = world.run()
    assert ended == Ended(exit_code=0, cause="")
    assert world.done == [
        (ROBOT, "configure"),
        (ESTIMATOR, "configure"),
        (CONTROLLER, "configure"),
        (ROBOT, "activate"),
        (ESTIMATOR, "activate"),
        (CONTROLLER, "activate"),
        *((CONTROLLER, t) for t in ("deactivate", "cleanup", "shutdown")),
        *((ESTIMATOR, t) for t in ("deactivate", "cleanup", "shutdown")),
        *((ROBOT, t) for t in ("deactivate", "cleanup", "shutdown")),
    ]
    assert world.phases == ["starting", "ready", "active", "stopping", "stopped"]
    assert not world.alive


def test_the_duration_counts_from_the_end_of_the_bring_up() -> None:
    world = World()
    world.run(duration_s=7.5)
    assert world.now == pytest.approx(7.5)


def rejecting(seconds: float) -> RejectionReported:
    return RejectionReported(node=ROBOT, seconds=seconds, reason="`u` has the length 2")


def test_a_robot_that_rejects_commands_to_the_end_fails_the_run() -> None:
    world = World(later=deque([rejecting(1.0), 1.0, rejecting(2.0)]))
    ended = world.run()
    assert (ended.exit_code, ended.consequences) == (1, 0)
    assert ROBOT in ended.cause
    assert "`u` has the length 2" in ended.cause
    assert world.phases[-3:] == ["active", "stopping", "stopped"]


def test_a_robot_that_accepts_commands_again_does_not_fail_the_run() -> None:
    assert World(later=deque([rejecting(3.0), 1.0, rejecting(0.0)])).run().exit_code == 0


def test_rejections_before_a_deactivation_or_restart_do_not_fail_the_run() -> None:
    deactivated = StateSeen(node=ROBOT, state="inactive", transition="deactivate")
    assert World(later=deque([rejecting(2.0), deactivated])).run().exit_code == 0
    world = World(on_crash="restart")
    start = world.start

    def start_awake(unit: Unit) -> None:
        world.mute.discard(ROBOT)
        start(unit)

    world.start = start_awake  # type: ignore[method-assign]
    world.later.extend([rejecting(2.0), lambda: world.mute.add(ROBOT), 20.0])
    ended = world.run(duration_s=30.0)
    assert world.of(Restarted)
    assert ended.exit_code == 0, ended.cause


def test_until_configured_activates_no_node() -> None:
    world = World()
    world.run(until="configured")
    assert "activate" not in {transition for _, transition in world.done}
    assert "configured" in world.phases


def test_until_none_makes_only_the_last_transition() -> None:
    world = World()
    world.run(until="none")
    assert {transition for _, transition in world.done} == {"shutdown"}


def test_a_requested_stop_ends_cleanly() -> None:
    world = World(later=deque([StopRequested(reason="SIGINT")]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    stopping = Phase(name="stopping", seconds=0.0, detail="SIGINT")
    assert stopping in world.published
    assert world.published.index(stopping) < world.published.index(
        StackStateChanged(state="shuttingdown")
    )


def test_a_process_without_a_node_such_as_the_recorder_is_ignored() -> None:
    end = ProcessEnded(process="/recorder", code=1)
    world = World(later=deque([ProcessStarted(process="/recorder", pid=7), end]))
    assert world.run() == Ended(exit_code=0, cause="")
    assert end not in world.published


def test_a_rejected_activate_rolls_its_tier_back_and_fails_with_the_nodes_own_message() -> None:
    world = World(refuses={(ESTIMATOR, "activate"): "on_activate: ValueError: no gain\nTraceback"})
    ended = world.run()
    assert ended.exit_code == 1
    assert ended.cause == (
        f"{ESTIMATOR}: the transition `activate` failed: on_activate: ValueError: no gain"
    )
    assert (CONTROLLER, "activate") not in world.done
    assert (ROBOT, "deactivate") in world.done
    assert not world.alive


def test_nodes_of_a_tier_that_did_make_a_failed_step_are_rolled_back() -> None:
    two = Plan(name="s", nodes=(*PLAN.nodes, process("robot", 1)))
    world = World(refuses={("/obelisk_robot_1", "configure"): "no"}, plan=two)
    world.run()
    assert "rolling back" in world.phases
    assert world.done[:3] == [
        (ROBOT, "configure"),
        ("/obelisk_robot_1", "configure"),
        (ROBOT, "cleanup"),
    ]


def test_a_transition_without_an_answer_is_a_timeout() -> None:
    world = World(silent={(ROBOT, "configure")})
    ended = world.run()
    assert ended.cause == f"{ROBOT}: the transition `configure` did not finish within 10.0 s"
    assert (
        TransitionEnded(node=ROBOT, transition="configure", result="timed out", seconds=10.0)
        in world.published
    )


def test_a_node_that_never_starts_is_named() -> None:
    world = World(never_ready={ESTIMATOR})
    ended = world.run()
    assert ended.cause == f"no lifecycle services after 20 s: {ESTIMATOR}"
    assert world.done == [(CONTROLLER, "shutdown"), (ROBOT, "shutdown")]


def test_a_process_that_dies_takes_the_stack_down_and_is_the_cause() -> None:
    world = World(later=deque([ProcessEnded(process=ROBOT, code=-11)]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 1
    assert ended.cause == f"{ROBOT}: the process was terminated by SIGSEGV"
    assert (ROBOT, "deactivate") not in world.done
    assert (ROBOT, signal.SIGINT) not in world.signals
    assert not world.alive


def test_a_process_that_dies_during_a_request_ends_the_wait_immediately() -> None:
    world = World(silent={(ROBOT, "configure")}, later=deque([ProcessEnded(process=ROBOT, code=3)]))
    ended = world.run()
    assert ended.cause == f"{ROBOT}: the process exited with code 3"
    assert world.now == 0.0


def test_a_process_that_cannot_start_is_reported_with_its_reason() -> None:
    world = World(never_ready={ROBOT})
    world.inbox.append(ProcessEnded(process=ROBOT, code=127, text="it cannot start: no such file"))
    assert world.run().cause == (
        f"{ROBOT}: the process exited with code 127: it cannot start: no such file"
    )


def test_a_node_that_fails_by_itself_takes_the_stack_down() -> None:
    world = World(later=deque([Failed(node=CONTROLLER, fault="compute_control: boom\nTrace")]))
    ended = world.run(duration_s=None)
    assert ended.cause == f"{CONTROLLER} failed: compute_control: boom"
    assert world.published.count(Failed(node=CONTROLLER, fault="compute_control: boom\nTrace")) == 1


def test_consequences_are_counted_not_reported_as_causes() -> None:
    world = World(
        later=deque([ProcessEnded(process=ROBOT, code=1)]),
        deaf_to={(ESTIMATOR, n) for n in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)},
    )
    ended = world.run(duration_s=None)
    assert ended.cause.startswith(ROBOT)
    assert ended.consequences == 1


def test_a_process_that_ignores_sigint_gets_harder_signals() -> None:
    world = World(deaf_to={(ROBOT, signal.SIGINT), (ROBOT, signal.SIGTERM)})
    world.run()
    assert [n for node, n in world.signals if node == ROBOT] == [
        signal.SIGINT,
        signal.SIGTERM,
        signal.SIGKILL,
    ]
    assert not world.alive
    ignored = [event for event in world.published if isinstance(event, SignalIgnored)]
    assert [(event.processes, event.signal) for event in ignored] == [
        ((ROBOT,), "SIGINT"),
        ((ROBOT,), "SIGTERM"),
    ]


def test_a_finalized_node_whose_process_ends_slowly_has_ended_cleanly() -> None:
    world = World(deaf_to={(ROBOT, signal.SIGINT)})
    ended = world.run()
    assert (ROBOT, signal.SIGTERM) in world.signals
    assert (ended.exit_code, ended.cause) == (0, "")


def test_a_node_that_does_not_shut_down_and_ends_by_sigterm_has_not_ended_cleanly() -> None:
    world = World(silent={(ROBOT, "shutdown")}, deaf_to={(ROBOT, signal.SIGINT)})
    ended = world.run()
    assert ended.exit_code == 1
    assert "`shutdown` did not finish within 3.0 s" in ended.cause
    assert ended.consequences == 1


def test_a_killed_process_is_no_clean_end() -> None:
    world = World(deaf_to={(ROBOT, signal.SIGINT), (ROBOT, signal.SIGTERM)})
    ended = world.run()
    assert ended.exit_code == 1
    assert ended.cause == f"{ROBOT}: the process was terminated by SIGKILL"


def test_a_node_without_a_response_during_shutdown_gets_no_more_requests() -> None:
    world = World(silent={(CONTROLLER, "deactivate")})
    ended = world.run()
    assert ended.exit_code == 1
    assert "`deactivate` did not finish within 3.0 s" in ended.cause
    assert (CONTROLLER, "cleanup") not in world.done
    assert (ROBOT, "shutdown") in world.done


def test_a_stop_before_a_node_is_ready_ends_it_without_a_word_of_python() -> None:
    world = World(never_ready={ROBOT}, later=deque([StopRequested(reason="SIGINT")]))
    ended = world.run()
    assert (ROBOT, signal.SIGTERM) in world.signals
    assert (ROBOT, signal.SIGINT) not in world.signals
    assert ended.exit_code == 0


def test_a_failure_in_a_requested_transition_is_reported_once() -> None:
    world = World(
        silent={(ROBOT, "configure")},
        later=deque(
            [
                Failed(node=ROBOT, fault="on_configure: x", transition="configure"),
                Answered(node=ROBOT, transition="configure", success=False, fault="x"),
            ]
        ),
    )
    ended = world.run()
    assert ended.cause == f"{ROBOT}: the transition `configure` failed: x"
    assert ended.consequences == 0
    assert not [event for event in world.published if isinstance(event, Failed)]


def test_a_stack_that_is_shut_down_from_elsewhere_ends_cleanly() -> None:
    seen = [
        StateSeen(node=node, state="finalized", transition="shutdown")
        for node in (CONTROLLER, ESTIMATOR, ROBOT)
    ]
    world = World(later=deque(seen))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    assert seen[0] in world.published


def test_a_state_changed_from_elsewhere_is_known_on_the_way_down() -> None:
    seen = StateSeen(node=CONTROLLER, state="inactive", transition="deactivate")
    world = World(later=deque([seen, StopRequested(reason="SIGTERM")]))
    world.run(duration_s=None)
    assert (CONTROLLER, "deactivate") not in world.done
    assert (CONTROLLER, "cleanup") in world.done


def test_an_old_message_does_not_stand_for_the_state_after_the_latest_answer() -> None:
    late = StateSeen(node=CONTROLLER, state="inactive", transition="configure")
    world = World(stale=late, later=deque([late, StopRequested(reason="SIGINT")]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    assert late not in world.published
    assert world.transitions_of(CONTROLLER)[2:] == ["deactivate", "cleanup", "shutdown"]


def test_a_node_that_became_active_after_its_deadline_is_deactivated() -> None:
    world = World(unanswered={(ROBOT, "activate")})
    ended = world.run()
    assert ended.cause == f"{ROBOT}: the transition `activate` did not finish within 10.0 s"
    assert ended.consequences == 0
    assert world.transitions_of(ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]


def test_a_node_in_the_middle_of_a_transition_gets_its_requests_in_turn() -> None:
    world = World(silent={(ROBOT, "activate")}, refuses={(ROBOT, "deactivate"): "not possible"})
    answer = world.ask_state

    def ask_state(node: str) -> None:
        world.states[node] = "activating" if node == ROBOT else world.states[node]
        answer(node)

    world.ask_state = ask_state  # type: ignore[method-assign]
    ended = world.run()
    assert world.transitions_of(ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]
    assert ended.consequences == 0


def test_a_silent_node_hangs_and_gets_no_more_requests() -> None:
    world = World(mute={ROBOT})
    ended = world.run()
    assert world.transitions_of(ROBOT) == ["configure", "activate"]
    assert ended.cause == f"{ROBOT} hangs: no answer for 1.8 s"
    assert (ROBOT, signal.SIGKILL) in world.signals


JOY = replace(process("joystick"), node="obelisk_joystick", has_lifecycle=False)


def test_a_process_without_a_lifecycle_is_only_started_watched_and_signaled() -> None:
    world = World(plan=Plan(name="s", nodes=(*PLAN.nodes, JOY)))
    ended = world.run()
    assert ended == Ended(exit_code=0, cause="")
    assert not world.transitions_of(JOY.full_name)
    assert [n for node, n in world.signals if node == JOY.full_name] == [signal.SIGINT]


def test_the_death_of_a_process_without_a_lifecycle_takes_the_stack_down() -> None:
    died = ProcessEnded(process=JOY.full_name, code=1)
    world = World(plan=Plan(name="s", nodes=(*PLAN.nodes, JOY)), later=deque([died]))
    assert world.run(duration_s=None).cause == f"{JOY.full_name}: the process exited with code 1"


def test_a_process_without_a_sigint_handler_ends_cleanly_by_it() -> None:
    world = World(plan=Plan(name="s", nodes=(JOY,)), deaf_to={(JOY.full_name, signal.SIGINT)})
    world.later.append(ProcessEnded(process=JOY.full_name, code=-signal.SIGINT))
    world.later.appendleft(StopRequested(reason="SIGTERM"))
    assert world.run(duration_s=None).exit_code == 0


def test_a_stop_during_the_bring_up_ends_the_wait_immediately() -> None:
    world = World(silent={(ROBOT, "configure")}, mute={ROBOT})
    world.later.append(StopRequested(reason="SIGINT"))
    ended = world.run()
    assert ended.exit_code == 0
    assert world.now == 2.0  # the request for its state
    assert world.phases == ["starting", "ready", "stopping", "stopped"]


def test_a_second_stop_skips_the_transitions_that_are_left_and_shortens_the_grace() -> None:
    again = StopRequested(reason="SIGINT", is_urgent=True)
    world = World(
        silent={(CONTROLLER, "deactivate")},
        deaf_to={(ROBOT, signal.SIGINT), (ROBOT, signal.SIGTERM)},
        later=deque([again, 1.0, again]),
    )
    world.run(duration_s=None)
    assert world.transitions_of(CONTROLLER) == ["configure", "activate", "deactivate"]
    assert (ESTIMATOR, "deactivate") not in world.done
    assert (ROBOT, signal.SIGKILL) in world.signals
    assert world.now == 1.0 + 2 * 0.5


def test_two_simultaneous_signals_are_one_request() -> None:
    stop = StopRequested(reason="SIGTERM", is_urgent=True)
    world = World(silent={(CONTROLLER, "deactivate")}, later=deque([stop, stop]))
    world.run(duration_s=None)
    assert world.transitions_of(ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]


def test_a_stop_that_is_not_urgent_does_not_hurry_nodes() -> None:
    stop = StopRequested(reason="SIGHUP")
    world = World(silent={(CONTROLLER, "deactivate")}, later=deque([stop, 1.0, stop]))
    world.run(duration_s=None)
    assert (ROBOT, "deactivate") in world.done


@pytest.mark.parametrize(("on_crash", "exit_code"), [("stop", 1), ("restart", 0)])
def test_a_node_whose_fault_is_unknown_counts_as_crashed(on_crash: OnCrash, exit_code: int) -> None:
    fault = Failed(node=CONTROLLER, fault=UNKNOWN_FAULT, transition="deactivate")
    world = World(on_crash=on_crash, later=deque([fault]))
    ended = world.run()
    assert ended.exit_code == exit_code
    assert len(world.of(Restarted)) == (on_crash == "restart")


def test_a_requested_transition_may_take_as_long_as_the_request_allows() -> None:
    world = World(silent={(CONTROLLER, "deactivate")})
    answers: list[ChangeAnswer] = []
    change = ChangeRequested(
        transition="deactivate", nodes=(CONTROLLER,), timeout_s=60.0, reply=answers.append
    )

    def finish() -> None:
        world.mute.discard(CONTROLLER)
        world.silent.clear()
        world.inbox.append(
            Answered(node=CONTROLLER, transition="deactivate", success=True, fault="")
        )

    world.later.extend(
        [
            lambda: world.mute.add(CONTROLLER),
            change,
            TransitionStarted(node=CONTROLLER, transition="deactivate"),
            30.0,
            finish,
        ]
    )
    ended = world.run(duration_s=60.0)
    assert ended.exit_code == 0, ended.cause
    assert [answer.success for answer in answers] == [True]
    assert not world.of(Hung)


def test_terminating_a_node_in_its_constructor_does_not_fail_the_run() -> None:
    """The first SIGTERM waits for the constructor; the second one ends the process."""
    world = World(never_ready={CONTROLLER}, deaf_to={(CONTROLLER, signal.SIGTERM)})
    terminate = world.signal

    def end_at_the_second(process: str, number: int) -> None:
        terminate(process, number)
        if world.signals.count((CONTROLLER, signal.SIGTERM)) == 2 and CONTROLLER in world.alive:
            world.alive.discard(CONTROLLER)
            world.inbox.append(ProcessEnded(process=CONTROLLER, code=128 + signal.SIGTERM))

    world.signal = end_at_the_second  # type: ignore[method-assign]
    world.later.extend([1.0, StopRequested(reason="SIGINT", is_urgent=True)])
    ended = world.run()
    ignored = [event for event in world.published if isinstance(event, SignalIgnored)]
    assert [(event.processes, event.signal) for event in ignored] == [((CONTROLLER,), "SIGTERM")]
    assert ended.exit_code == 0, ended.cause


def test_a_fault_in_a_transition_requested_elsewhere_keeps_the_stack_running() -> None:
    fault = Failed(node=ROBOT, fault="on_configure: x", transition="configure")
    world = World(later=deque([fault]))
    ended = world.run(until="none")
    assert ended.exit_code == 0
    assert fault in world.published
    assert world.now == pytest.approx(5.0)


def test_a_signal_without_a_name_is_reported_by_its_number() -> None:
    assert ProcessEnded(process=ROBOT, code=-40).how == "the process was terminated by signal 40"
    for code in (-signal.SIGTERM, 128 + signal.SIGTERM):
        ended = ProcessEnded(process=ROBOT, code=code, text="the last output")
        assert ended.how == "the process was terminated by SIGTERM"
