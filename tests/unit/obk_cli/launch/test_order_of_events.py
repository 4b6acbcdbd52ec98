"""What happens while something else is under way: crashes, late answers, hangs, stops."""

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


def test_controllers_are_not_activated_again_when_a_crash_brings_the_stack_down() -> None:
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
    """The robot is activated half a second after everybody gave it up."""

    def arrive() -> None:
        world.states[ROBOT] = "active"
        world.inbox.append(Answered(node=ROBOT, transition="activate", success=True, fault=""))

    world.silent.add((ROBOT, "activate"))
    world.later.extend([ignored("activate"), 11.0, arrive, 1.0, STOP])


def test_a_node_that_becomes_active_after_its_change_was_given_up_is_taken_back() -> None:
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


def test_a_node_that_is_deactivated_late_stays_so_and_is_known_to_be() -> None:
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


def test_nodes_of_a_restarted_process_come_up_robot_first() -> None:
    world = World(on_crash="restart", together=ALL)
    world.later.extend([died("/s/composed"), 2.0, STOP])
    assert world.run(duration_s=None).exit_code == 0
    assert world.done[6:12] == [
        (node, transition)
        for transition in ("configure", "activate")
        for node in (ROBOT, ESTIMATOR, CONTROLLER)
    ]


def test_a_node_that_fails_beside_others_in_its_process_is_brought_back_alone() -> None:
    world = World(on_crash="restart", together=ALL)
    world.later.extend([Failed(node=ESTIMATOR, fault="compute: boom"), 2.0, STOP])
    assert world.run(duration_s=None).exit_code == 0
    assert world.transitions_of(ESTIMATOR)[2:4] == ["configure", "activate"]
    assert world.transitions_of(ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]
    assert world.of(Restarted) == [Restarted(nodes=(ESTIMATOR,))]


def test_what_a_dead_process_did_not_tell_is_not_taken_for_the_news_of_the_next_one() -> None:
    world = World(on_crash="restart")
    off = StateSeen(node=ROBOT, state="inactive", transition="deactivate")
    on = StateSeen(node=ROBOT, state="active", transition="activate")
    world.later.extend([died(), 1.0, on, off, on, STOP])
    world.run(duration_s=None)
    assert world.of(StateSeen) == [off, on]


def test_the_last_words_of_a_dead_process_do_not_bring_its_node_to_life() -> None:
    off = StateSeen(node=ROBOT, state="inactive", transition="deactivate")
    world = World(on_crash="restart", later=deque([died(), off, 1.0, STOP]))
    world.run(duration_s=None)
    assert world.transitions_of(ROBOT)[2:4] == ["configure", "cleanup"]
    after = published_states(world)[published_states(world).index("active") + 1 :]
    assert after[:2] == ["unconfigured", "inactive"]


def test_the_only_node_failing_for_good_is_no_end_in_order() -> None:
    end = StateSeen(node=ROBOT, state="finalized")
    failed = Failed(node=ROBOT, fault="compute: boom")
    world = World(plan=Plan(name="s", nodes=(process("robot"),)))
    world.later.extend([end, failed])
    ended = world.run(duration_s=None)
    assert ended.exit_code == 1
    assert ended.cause == f"{ROBOT} failed: compute: boom"


def test_a_stack_is_not_up_while_one_that_got_there_has_died_since() -> None:
    world = World(on_crash="restart", silent={(CONTROLLER, "activate")})

    def answer() -> None:
        world.silent.clear()
        world.inbox.append(Answered(node=CONTROLLER, transition="activate", success=True, fault=""))

    world.later.extend([died(), answer])
    assert world.run().exit_code == 0
    assert position(world, Restarted) < position(world, Phase, "active")


def test_what_was_deactivated_and_dies_in_the_same_change_does_not_come_back_active() -> None:
    world = World(on_crash="restart", silent={(ROBOT, "deactivate")})

    def answer() -> None:
        world.silent.clear()
        world.inbox.append(Answered(node=ROBOT, transition="deactivate", success=True, fault=""))

    world.later.extend([ignored("deactivate"), died(CONTROLLER), answer, 1.0, STOP])
    world.run(duration_s=None)
    assert world.transitions_of(CONTROLLER)[2:5] == ["deactivate", "configure", "cleanup"]


def test_a_hung_node_that_answers_again_before_its_turn_is_left_alone() -> None:
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


def test_a_hung_node_is_not_asked_for_what_it_would_do_once_it_wakes() -> None:
    answers: list[ChangeAnswer] = []
    world = World(on_crash="ignore")
    asked = ChangeRequested(transition="deactivate", nodes=(ESTIMATOR,), reply=answers.append)
    world.later.extend([lambda: world.mute.add(ESTIMATOR), 5.0, asked, STOP])
    world.run(duration_s=None)
    assert answers[0].why == (
        f"{ESTIMATOR}: the transition `deactivate` was interrupted: the node hangs"
    )
    assert "deactivate" not in world.transitions_of(ESTIMATOR)


def test_a_restarted_process_that_neither_comes_up_nor_can_be_killed_is_reported() -> None:
    world = World(on_crash="restart", deaf_to={(ROBOT, n) for n in range(1, 32)})
    world.later.extend([lambda: world.never_ready.add(ROBOT), died()])
    ended = world.run(duration_s=None)
    assert ended.cause == f"{ROBOT}: the process is still running after SIGKILL"


def test_a_node_that_fails_after_its_restart_says_why_in_the_cause() -> None:
    world = World(on_crash="restart")
    world.later.extend([lambda: world.refuses.update({(ROBOT, "configure"): "no gain"}), died()])
    assert world.run(duration_s=None).cause.endswith(
        "the transition `configure` failed after a restart: no gain"
    )


class HeldUp(World):
    """The launcher itself stands still for 30 s, while the robot is configured."""

    was_held_up = False

    def get(self, *, timeout: float | None) -> InputEvent:
        if not self.inbox and (ROBOT, "configure") in self.done and not self.was_held_up:
            self.was_held_up = True
            self.now += 30.0
            self.later.append(0.1)
            self.later.append(Answered(node=ROBOT, transition="configure", success=True, fault=""))
            raise Empty
        return super().get(timeout=timeout)


def test_no_one_is_blamed_for_the_time_in_which_the_launcher_stood_still() -> None:
    world = HeldUp(silent={(ROBOT, "configure")})
    assert world.run().exit_code == 0


def test_nothing_is_started_again_once_the_stop_was_asked_for() -> None:
    world = World(on_crash="restart", later=deque([died(), 0.05, STOP]))
    world.run(duration_s=None)
    assert world.started.count(ROBOT) == 1


def test_a_stop_does_not_wait_for_the_end_of_a_process_that_was_to_be_restarted() -> None:
    world = World(on_crash="restart", deaf_to={(ROBOT, 9)})
    world.later.extend([lambda: world.mute.add(ROBOT), 3.0, STOP])
    world.run(duration_s=None)
    assert when(world, "stopping") == pytest.approx(3.0)


def test_a_node_of_another_launch_that_was_started_again_is_where_it_says() -> None:
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


def test_the_end_of_a_shared_process_is_blamed_on_the_node_that_its_last_words_name() -> None:
    two = Plan(
        name="s",
        nodes=tuple(
            replace(process(section), origin=Origin(path="c.yaml", line=line, column=1))
            for line, section in enumerate(("control", "robot"), 1)
        ),
    )
    for text, origin in (("", ""), (f"{ROBOT} died", "c.yaml:2:1")):
        world = World(plan=two, together=ALL)
        world.later.append(ProcessEnded(process="/s/composed", code=1, text=text))
        assert world.run(duration_s=None).origin == origin


def test_a_node_that_is_reported_to_be_ready_once_more_stays_where_it_is() -> None:
    answers: list[ChangeAnswer] = []
    asked = ChangeRequested(transition="deactivate", nodes=(ROBOT,), reply=answers.append)
    world = World(later=deque([Ready(node=ROBOT), asked, STOP]))
    assert world.run(duration_s=None).exit_code == 0
    assert answers[0].success
