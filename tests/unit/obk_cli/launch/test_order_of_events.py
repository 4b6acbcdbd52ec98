"""Events during other activities: crashes, late replies, hangs, stops."""

from collections import deque
from dataclasses import replace
from queue import Empty

import pytest

from obk_cli.launch.events import (
    Answered,
    ChangeRequested,
    Failed,
    GoesOnWithout,
    InputEvent,
    OutputEvent,
    Phase,
    ProcessEnded,
    Ready,
    Restarted,
    StackStateChanged,
    StateSeen,
    StopRequested,
    TransitionEnded,
)
from obk_cli.plan.plan import Origin, Plan
from obk_cli.runs.protocol import ChangeAnswer

from .world import CONTROLLER, ESTIMATOR, ROBOT, World, process

STOP = StopRequested(reason="SIGINT")
ALL = frozenset({CONTROLLER, ESTIMATOR, ROBOT})


def died(name: str = ROBOT) -> ProcessEnded:
    return ProcessEnded(process=name, code=-11)


def ignored(transition: str, *nodes: str) -> ChangeRequested:
    return ChangeRequested(transition=transition, nodes=nodes, reply=lambda _: None)


def when(world: World, name: str) -> float:
    (begin,) = (e.seconds for e in world.published if isinstance(e, Phase) and e.name == name)
    return begin


def published_states(world: World) -> list[str]:
    return [event.state for event in world.published if isinstance(event, StackStateChanged)]


def position(world: World, wanted: type[OutputEvent], name: str = "") -> int:
    return next(
        n
        for n, event in enumerate(world.published)
        if isinstance(event, wanted) and name in ("", getattr(event, "name", ""))
    )


def test_controllers_are_not_activated_again_when_a_crash_stops_the_stack() -> None:
    world = World(silent={(ROBOT, "deactivate")})
    world.later.extend([ignored("deactivate"), 1.0, died()])
    world.run(duration_s=None)
    assert world.transitions_of(CONTROLLER).count("activate") == 1
    assert world.transitions_of(ESTIMATOR).count("activate") == 1


def test_a_crash_does_not_wait_for_another_nodes_slow_transition() -> None:
    world = World(silent={(ESTIMATOR, "deactivate")})
    world.later.extend([ignored("deactivate", ESTIMATOR), 1.0, died()])
    assert world.run(duration_s=None).cause == f"{ROBOT}: the process was terminated by SIGSEGV"
    assert when(world, "stopping") == 1.0


def test_a_crash_while_a_change_is_taken_back_ends_the_way_back() -> None:
    world = World(
        refuses={(ROBOT, "deactivate"): "on_deactivate: no"}, silent={(CONTROLLER, "activate")}
    )
    silent = world.silent
    world.silent = set()
    world.later.append(lambda: world.silent.update(silent))
    world.later.extend([ignored("deactivate"), 1.0, died(ESTIMATOR)])
    world.run(duration_s=None)
    assert when(world, "stopping") == 1.0


def late_activation(world: World) -> None:
    """The robot is activated half a second after the transition has timed out."""

    def arrive() -> None:
        world.states[ROBOT] = "active"
        world.inbox.append(Answered(node=ROBOT, transition="activate", success=True, fault=""))

    world.silent.add((ROBOT, "activate"))
    world.later.extend([ignored("activate"), 11.0, arrive, 1.0, STOP])


def test_a_node_that_becomes_active_after_its_change_timed_out_is_rolled_back() -> None:
    world = World()
    late_activation(world)
    assert world.run(until="configured", duration_s=None).exit_code == 0
    assert world.transitions_of(ROBOT) == [
        *("configure", "activate", "deactivate", "cleanup", "shutdown")
    ]
    assert "deactivating" in published_states(world)
    late = [e for e in world.of(TransitionEnded) if isinstance(e, TransitionEnded)][4]
    assert (late.node, late.transition, late.result) == (ROBOT, "activate", "reached")
    assert late.seconds == pytest.approx(11.0)


def test_a_late_deactivation_is_kept_and_known() -> None:
    answers: list[ChangeAnswer] = []
    world = World(silent={(ROBOT, "deactivate")})

    def arrive() -> None:
        world.states[ROBOT] = "inactive"
        world.inbox.append(Answered(node=ROBOT, transition="deactivate", success=True, fault=""))

    again = ChangeRequested(transition="cleanup", nodes=(ROBOT,), reply=answers.append)
    world.later.extend([ignored("deactivate", ROBOT), 11.0, arrive, 1.0, again, STOP])
    assert world.run(duration_s=None).exit_code == 0
    assert answers[0].success
    assert world.transitions_of(ROBOT).count("activate") == 1


def test_nodes_of_a_restarted_process_start_robot_first() -> None:
    world = World(on_crash="restart", together=ALL)
    world.later.extend([died("/s/composed"), 2.0, STOP])
    assert world.run(duration_s=None).exit_code == 0
    assert world.done[6:12] == [
        (node, transition)
        for transition in ("configure", "activate")
        for node in (ROBOT, ESTIMATOR, CONTROLLER)
    ]


def test_a_node_that_fails_in_a_shared_process_is_restarted_alone() -> None:
    world = World(on_crash="restart", together=ALL)
    world.later.extend([Failed(node=ESTIMATOR, fault="compute: boom"), 2.0, STOP])
    assert world.run(duration_s=None).exit_code == 0
    assert world.transitions_of(ESTIMATOR)[2:4] == ["configure", "activate"]
    assert world.transitions_of(ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]
    assert world.of(Restarted) == [Restarted(nodes=(ESTIMATOR,))]


def test_unreported_events_of_a_dead_process_are_not_attributed_to_the_next_one() -> None:
    world = World(on_crash="restart")
    off = StateSeen(node=ROBOT, state="inactive", transition="deactivate")
    on = StateSeen(node=ROBOT, state="active", transition="activate")
    world.later.extend([died(), 1.0, on, off, on, STOP])
    world.run(duration_s=None)
    assert world.of(StateSeen) == [off, on]


def test_the_last_output_of_a_dead_process_does_not_revive_its_node() -> None:
    off = StateSeen(node=ROBOT, state="inactive", transition="deactivate")
    world = World(on_crash="restart", later=deque([died(), off, 1.0, STOP]))
    world.run(duration_s=None)
    assert world.transitions_of(ROBOT)[2:4] == ["configure", "cleanup"]
    after = published_states(world)[published_states(world).index("active") + 1 :]
    assert after[:2] == ["unconfigured", "inactive"]


def test_the_permanent_failure_of_the_only_node_is_no_clean_end() -> None:
    end = StateSeen(node=ROBOT, state="finalized")
    failed = Failed(node=ROBOT, fault="compute: boom")
    world = World(plan=Plan(name="s", nodes=(process("robot"),)))
    world.later.extend([end, failed])
    ended = world.run(duration_s=None)
    assert ended.exit_code == 1
    assert ended.cause == f"{ROBOT} failed: compute: boom"


def test_a_stack_is_not_up_while_an_already_active_node_has_died() -> None:
    world = World(on_crash="restart", silent={(CONTROLLER, "activate")})

    def answer() -> None:
        world.silent.clear()
        world.inbox.append(Answered(node=CONTROLLER, transition="activate", success=True, fault=""))

    world.later.extend([died(), answer])
    assert world.run().exit_code == 0
    assert position(world, Restarted) < position(world, Phase, "active")


def test_a_node_that_dies_during_its_deactivation_is_not_activated_again() -> None:
    world = World(on_crash="restart", silent={(ROBOT, "deactivate")})

    def answer() -> None:
        world.silent.clear()
        world.inbox.append(Answered(node=ROBOT, transition="deactivate", success=True, fault=""))

    world.later.extend([ignored("deactivate"), died(CONTROLLER), answer, 1.0, STOP])
    world.run(duration_s=None)
    assert world.transitions_of(CONTROLLER)[2:5] == ["deactivate", "configure", "cleanup"]


def test_a_hung_node_that_responds_before_its_turn_is_kept() -> None:
    world = World(on_crash="restart")

    def wakes() -> None:
        world.mute.discard(CONTROLLER)

    def comes() -> None:
        world.never_ready.discard(ROBOT)
        world.watch([ROBOT])

    world.later.extend([lambda: world.never_ready.add(ROBOT), died()])
    world.later.extend([lambda: world.mute.add(CONTROLLER), 3.0, wakes, 1.0, comes, 3.0, STOP])
    assert world.run(duration_s=None).exit_code == 0
    assert world.started.count(CONTROLLER) == 1
    assert world.of(Restarted) == [Restarted(nodes=(ROBOT,))]


def test_a_hung_node_that_is_ignored_does_not_keep_the_others_from_a_change() -> None:
    answers: list[ChangeAnswer] = []
    world = World(on_crash="ignore", mute={ESTIMATOR})
    world.mute = set()
    world.later.extend([lambda: world.mute.add(ESTIMATOR), 5.0])
    world.later.extend([ChangeRequested(transition="deactivate", reply=answers.append), STOP])
    world.run(duration_s=None)
    assert answers[0].success
    assert [member.node for member in answers[0].members] == [CONTROLLER, ROBOT]


def test_a_hung_node_gets_no_requests_that_it_would_execute_later() -> None:
    answers: list[ChangeAnswer] = []
    world = World(on_crash="ignore")
    asked = ChangeRequested(transition="deactivate", nodes=(ESTIMATOR,), reply=answers.append)
    world.later.extend([lambda: world.mute.add(ESTIMATOR), 5.0, asked, STOP])
    world.run(duration_s=None)
    assert answers[0].why == (
        f"{ESTIMATOR}: the transition `deactivate` was interrupted: the node hangs"
    )
    assert "deactivate" not in world.transitions_of(ESTIMATOR)


def test_a_restarted_process_that_neither_starts_nor_can_be_killed_is_reported() -> None:
    world = World(on_crash="restart", deaf_to={(ROBOT, n) for n in range(1, 32)})
    world.later.extend([lambda: world.never_ready.add(ROBOT), died()])
    ended = world.run(duration_s=None)
    assert ended.cause == f"{ROBOT}: the process is still running after SIGKILL"


def test_a_node_that_fails_after_its_restart_reports_why_in_the_cause() -> None:
    world = World(on_crash="restart")
    world.later.extend([lambda: world.refuses.update({(ROBOT, "configure"): "no gain"}), died()])
    assert world.run(duration_s=None).cause.endswith(
        "the transition `configure` failed after a restart: no gain"
    )


class HeldUp(World):
    """The launcher itself is suspended for 30 s while the robot is being configured."""

    was_held_up = False

    def get(self, *, timeout: float | None) -> InputEvent:
        if not self.inbox and (ROBOT, "configure") in self.done and not self.was_held_up:
            self.was_held_up = True
            self.now += 30.0
            self.later.append(0.1)
            self.later.append(Answered(node=ROBOT, transition="configure", success=True, fault=""))
            raise Empty
        return super().get(timeout=timeout)


def test_a_suspension_of_the_launcher_is_no_fault_of_the_nodes() -> None:
    world = HeldUp(silent={(ROBOT, "configure")})
    assert world.run().exit_code == 0


def test_nothing_is_restarted_after_a_stop_request() -> None:
    world = World(on_crash="restart", later=deque([died(), 0.05, STOP]))
    world.run(duration_s=None)
    assert world.started.count(ROBOT) == 1


def test_a_stop_does_not_wait_for_the_end_of_a_process_that_was_to_be_restarted() -> None:
    world = World(on_crash="restart", deaf_to={(ROBOT, 9)})
    world.later.extend([lambda: world.mute.add(ROBOT), 3.0, STOP])
    world.run(duration_s=None)
    assert when(world, "stopping") == pytest.approx(3.0)


def test_a_restarted_node_of_another_launch_has_its_reported_state() -> None:
    answers: list[ChangeAnswer] = []
    two = Plan(name="s", nodes=(process("control", device="offboard"), process("robot")))
    world = World(plan=two, devices=frozenset({"offboard"}), on_crash="restart")

    def ends() -> None:
        world.mute.add(ROBOT)
        world.states[ROBOT] = "unconfigured"

    configure = ChangeRequested(transition="configure", nodes=(ROBOT,), reply=answers.append)
    world.later.extend([ends, 5.0, lambda: world.mute.discard(ROBOT), 1.0, configure, STOP])
    assert world.run(duration_s=None).exit_code == 0
    assert answers[0].success
    states = published_states(world)
    assert states[states.index("active") :][:4] == [
        "active",
        "unconfigured",
        "configuring",
        "inactive",
    ]


def test_a_node_that_failed_and_is_ignored_does_not_keep_the_others_from_a_change() -> None:
    answers: list[ChangeAnswer] = []
    world = World(on_crash="ignore", later=deque([Failed(node=ESTIMATOR, fault="boom")]))
    world.later.append(lambda: world.states.update({ESTIMATOR: "unconfigured"}))
    names = ("deactivate", "cleanup", "configure")
    world.later.extend(ChangeRequested(transition=name, reply=answers.append) for name in names)
    world.later.append(STOP)
    assert world.run(duration_s=None).exit_code == 0
    assert [answer.success for answer in answers] == [True, True, True]
    asked = [[member.node for member in answer.members] for answer in answers]
    assert asked == [[CONTROLLER, ROBOT], [CONTROLLER, ROBOT], [ROBOT, ESTIMATOR, CONTROLLER]]
    assert world.of(GoesOnWithout) == [GoesOnWithout(nodes=(ESTIMATOR,))]


def test_the_end_of_a_shared_process_is_attributed_to_the_node_that_starts_its_last_line() -> None:
    two = Plan(
        name="s",
        nodes=tuple(
            replace(process(section), origin=Origin(path="c.yaml", line=line, column=1))
            for line, section in enumerate(("control", "robot"), 1)
        ),
    )
    for text, origin in (
        ("", ""),
        (f"{ROBOT}: tick: no message of {CONTROLLER}", "c.yaml:2:1"),
        (f"[INFO] [obelisk_robot_0]: waiting for {CONTROLLER}", ""),
    ):
        world = World(plan=two, together=ALL)
        world.later.append(ProcessEnded(process="/s/composed", code=1, text=text))
        assert world.run(duration_s=None).origin == origin


def test_a_node_reported_as_ready_again_keeps_its_state() -> None:
    answers: list[ChangeAnswer] = []
    asked = ChangeRequested(transition="deactivate", nodes=(ROBOT,), reply=answers.append)
    world = World(later=deque([Ready(node=ROBOT, state="unconfigured"), asked, STOP]))
    assert world.run(duration_s=None).exit_code == 0
    assert answers[0].success


def test_a_node_that_something_else_has_configured_is_not_configured_again() -> None:
    world = World(found={ROBOT: "inactive"})
    assert world.run().exit_code == 0
    assert "configure" not in world.transitions_of(ROBOT)
    assert "activate" in world.transitions_of(ROBOT)


@pytest.mark.parametrize(
    ("transition", "code"), [("deactivate", 1), ("cleanup", 1), ("shutdown", 0)]
)
def test_a_process_that_exits_before_its_node_is_shut_down_fails_the_run(
    transition: str, code: int
) -> None:
    world = World(silent={(ROBOT, transition)})
    world.later.extend([STOP, ProcessEnded(process=ROBOT, code=0)])
    assert world.run(duration_s=None).exit_code == code
