"""The supervisor against a world of tables: no process, no ROS, no waiting."""

import signal
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from queue import Empty

from obk_cli.launch.events import (
    Answered,
    Ended,
    Failed,
    Heard,
    Phase,
    ProcessEnded,
    ProcessStarted,
    Ready,
    StateAnswered,
    StateSeen,
    StopAsked,
    Told,
    TransitionEnded,
)
from obk_cli.launch.order import Until
from obk_cli.launch.supervisor import Limits, Supervisor
from obk_cli.launch.transitions import TRANSITIONS
from obk_cli.plan import Origin, Plan, Process

ROBOT, ESTIMATOR, CONTROLLER = "/obelisk_robot_0", "/obelisk_estimation_0", "/obelisk_control_0"


def process(section: str, index: int = 0) -> Process:
    return Process(
        node=f"obelisk_{section}_{index}",
        namespace="/",
        section=section,
        device="onboard",
        package="p",
        executable="e",
        origin=Origin(path="c.yaml", line=1, column=1),
    )


PLAN = Plan(name="s", processes=tuple(map(process, ("control", "estimation", "robot"))))


@dataclass
class World:
    """Processes, nodes, inbox and clock in one; behaves well unless told otherwise."""

    refuses: dict[tuple[str, str], str] = field(default_factory=dict)
    silent: set[tuple[str, str]] = field(default_factory=set)
    never_ready: set[str] = field(default_factory=set)
    deaf_to: set[tuple[str, int]] = field(default_factory=set)
    unheard: set[tuple[str, str]] = field(default_factory=set)
    """Transitions that are made, and whose answers are lost."""
    stale: StateSeen | None = None
    """One that comes when it is not true any more."""
    mute: set[str] = field(default_factory=set)
    """Do not even tell their state."""
    plan: Plan = PLAN
    states: dict[str, str] = field(default_factory=dict)
    later: deque[Heard | float] = field(default_factory=deque)
    """What happens once nothing else does; a number is time that passes [s]."""
    now: float = 0.0
    heard: deque[Heard] = field(default_factory=deque)
    told: list[Told] = field(default_factory=list)
    done: list[tuple[str, str]] = field(default_factory=list)
    signals: list[tuple[str, int]] = field(default_factory=list)
    alive: set[str] = field(default_factory=set)

    def start(self, process: Process) -> None:
        name = process.full_name
        self.alive.add(name)
        self.heard.append(ProcessStarted(node=name, pid=1))

    def signal(self, node: str, number: int) -> None:
        self.signals.append((node, number))
        if (node, number) not in self.deaf_to:
            self.alive.discard(node)
            code = 0 if number == signal.SIGINT else -number
            self.heard.append(ProcessEnded(node=node, code=code))

    def watch(self, nodes: Iterable[str]) -> None:
        self.heard.extend(Ready(node=node) for node in nodes if node not in self.never_ready)

    def ask_state(self, node: str) -> None:
        if node not in self.mute:
            state = self.states.get(node, "unconfigured")
            self.heard.append(StateAnswered(node=node, state=state))

    def request(self, node: str, transition: str) -> None:
        self.done.append((node, transition))
        if (node, transition) in self.silent:
            return
        fault = self.refuses.get((node, transition))
        if fault is None:
            self.states[node] = TRANSITIONS[transition].goal
        if (node, transition) in self.unheard:
            return
        self.heard.append(
            Answered(node=node, transition=transition, success=fault is None, fault=fault or "")
        )

    def get(self, *, timeout: float | None) -> Heard:
        if self.heard:
            return self.heard.popleft()
        while self.later:
            if not isinstance(self.later[0], float):
                return self._happens(self.later.popleft())
            assert timeout is None or self.later[0] <= timeout, "a deadline comes first"
            passed = self.later.popleft()
            self.now += passed
            timeout = None if timeout is None else timeout - passed
        assert timeout is not None, "nothing will ever happen again"
        self.now += timeout
        raise Empty

    def _happens(self, heard: Heard) -> Heard:
        if isinstance(heard, StateSeen) and heard != self.stale:
            self.states[heard.node] = heard.state
        return heard

    def run(self, until: Until = "active", duration_s: float | None = 5.0) -> Ended:
        supervisor = Supervisor(
            self.plan,
            processes=self,
            lifecycle=self,
            inbox=self,
            clock=lambda: self.now,
            tell=self.told.append,
            limits=Limits(
                transition_s=10, start_s=20, grace_s=3, down_s=3, answer_s=2, hurry_s=0.5
            ),
        )
        return supervisor.run(until, duration_s)

    @property
    def phases(self) -> list[str]:
        return [event.name for event in self.told if isinstance(event, Phase)]


def test_a_stack_comes_up_robot_first_and_goes_down_controllers_first() -> None:
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
    assert world.now == 7.5


def test_until_configured_activates_nobody() -> None:
    world = World()
    world.run(until="configured")
    assert "activate" not in {transition for _, transition in world.done}
    assert "configured" in world.phases


def test_until_none_makes_no_transition_but_the_last() -> None:
    world = World()
    world.run(until="none")
    assert {transition for _, transition in world.done} == {"shutdown"}


def test_a_stop_that_is_asked_for_ends_in_order() -> None:
    world = World(later=deque([StopAsked(reason="SIGINT")]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    assert Phase(name="stopping", seconds=0.0, detail="SIGINT") in world.told


def test_a_refused_activate_takes_its_tier_back_and_fails_with_the_nodes_own_words() -> None:
    world = World(refuses={(ESTIMATOR, "activate"): "on_activate: ValueError: no gain\nTraceback"})
    ended = world.run()
    assert ended.exit_code == 1
    assert ended.cause == (
        f"{ESTIMATOR}: the transition 'activate' failed: on_activate: ValueError: no gain"
    )
    assert (CONTROLLER, "activate") not in world.done
    assert (ROBOT, "deactivate") in world.done
    assert not world.alive


def test_nodes_of_a_tier_that_did_make_a_failed_step_are_rolled_back() -> None:
    two = Plan(name="s", processes=(*PLAN.processes, process("robot", 1)))
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
    assert ended.cause == f"{ROBOT}: the transition 'configure' was not done within 10.0 s"
    assert (
        TransitionEnded(node=ROBOT, transition="configure", result="timed out", seconds=10.0)
        in world.told
    )


def test_a_node_that_never_comes_up_is_named() -> None:
    world = World(never_ready={ESTIMATOR})
    ended = world.run()
    assert ended.cause == f"no life-cycle services after 20 s: {ESTIMATOR}"
    assert world.done == [(CONTROLLER, "shutdown"), (ROBOT, "shutdown")]


def test_a_process_that_dies_takes_the_stack_down_and_is_the_cause() -> None:
    world = World(later=deque([ProcessEnded(node=ROBOT, code=-11)]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 1
    assert ended.cause == f"{ROBOT}: the process was ended by SIGSEGV"
    assert (ROBOT, "deactivate") not in world.done
    assert (ROBOT, signal.SIGINT) not in world.signals
    assert world.alive == {ROBOT}  # this world's table is not told of its own news


def test_a_process_that_dies_while_it_is_asked_ends_the_wait_at_once() -> None:
    world = World(silent={(ROBOT, "configure")}, later=deque([ProcessEnded(node=ROBOT, code=3)]))
    ended = world.run()
    assert ended.cause == f"{ROBOT}: the process exited with code 3"
    assert world.now == 0.0


def test_a_process_that_cannot_start_is_told_with_its_reason() -> None:
    world = World(never_ready={ROBOT})
    world.heard.append(ProcessEnded(node=ROBOT, code=127, text="it cannot start: no such file"))
    assert world.run().cause == (
        f"{ROBOT}: the process exited with code 127: it cannot start: no such file"
    )


def test_a_node_that_fails_by_itself_takes_the_stack_down() -> None:
    world = World(later=deque([Failed(node=CONTROLLER, fault="compute_control: boom\nTrace")]))
    ended = world.run(duration_s=None)
    assert ended.cause == f"{CONTROLLER} failed: compute_control: boom"
    assert world.told.count(Failed(node=CONTROLLER, fault="compute_control: boom\nTrace")) == 1


def test_consequences_are_counted_not_told_as_causes() -> None:
    world = World(
        later=deque([ProcessEnded(node=ROBOT, code=1)]),
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


def test_a_process_that_had_to_be_killed_is_no_end_in_order() -> None:
    world = World(deaf_to={(ROBOT, signal.SIGINT), (ROBOT, signal.SIGTERM)})
    ended = world.run()
    assert ended.exit_code == 1
    assert ended.cause == f"{ROBOT}: the process was ended by SIGKILL"


def test_a_node_without_an_answer_on_the_way_down_is_asked_nothing_more() -> None:
    world = World(silent={(CONTROLLER, "deactivate")})
    ended = world.run()
    assert ended.exit_code == 1
    assert "'deactivate' was not done within 3.0 s" in ended.cause
    assert (CONTROLLER, "cleanup") not in world.done
    assert (ROBOT, "shutdown") in world.done


def test_a_stop_before_a_node_is_ready_ends_it_without_a_word_of_python() -> None:
    world = World(never_ready={ROBOT}, later=deque([StopAsked(reason="SIGINT")]))
    ended = world.run()
    assert (ROBOT, signal.SIGTERM) in world.signals
    assert (ROBOT, signal.SIGINT) not in world.signals
    assert ended.exit_code == 0


def test_a_failure_in_a_transition_that_was_asked_for_is_told_once() -> None:
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
    assert ended.cause == f"{ROBOT}: the transition 'configure' failed: x"
    assert ended.consequences == 0
    assert not [event for event in world.told if isinstance(event, Failed)]


def test_a_stack_that_is_shut_down_from_elsewhere_ends_in_order() -> None:
    seen = [
        StateSeen(node=node, state="finalized", transition="shutdown")
        for node in (CONTROLLER, ESTIMATOR, ROBOT)
    ]
    world = World(later=deque(seen))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    assert seen[0] in world.told


def test_a_state_changed_from_elsewhere_is_known_on_the_way_down() -> None:
    seen = StateSeen(node=CONTROLLER, state="inactive", transition="deactivate")
    world = World(later=deque([seen, StopAsked(reason="SIGTERM")]))
    world.run(duration_s=None)
    assert (CONTROLLER, "deactivate") not in world.done
    assert (CONTROLLER, "cleanup") in world.done


def transitions_of(world: World, node: str) -> list[str]:
    return [transition for name, transition in world.done if name == node]


def test_an_old_message_does_not_stand_for_the_state_after_the_newest_answer() -> None:
    late = StateSeen(node=CONTROLLER, state="inactive", transition="configure")
    world = World(stale=late, later=deque([late, StopAsked(reason="SIGINT")]))
    ended = world.run(duration_s=None)
    assert ended.exit_code == 0
    assert late not in world.told
    assert transitions_of(world, CONTROLLER)[2:] == ["deactivate", "cleanup", "shutdown"]


def test_a_node_that_became_active_after_its_deadline_is_deactivated() -> None:
    world = World(unheard={(ROBOT, "activate")})
    ended = world.run()
    assert ended.cause == f"{ROBOT}: the transition 'activate' was not done within 10.0 s"
    assert ended.consequences == 0
    assert transitions_of(world, ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]


def test_a_node_in_the_middle_of_a_transition_is_asked_for_everything_in_turn() -> None:
    world = World(silent={(ROBOT, "activate")}, refuses={(ROBOT, "deactivate"): "not possible"})
    answer = world.ask_state

    def ask_state(node: str) -> None:
        world.states[node] = "activating" if node == ROBOT else world.states[node]
        answer(node)

    world.ask_state = ask_state  # type: ignore[method-assign]
    ended = world.run()
    assert transitions_of(world, ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]
    assert ended.consequences == 0


def test_a_mute_node_is_asked_nothing_more() -> None:
    world = World(mute={ROBOT})
    ended = world.run()
    assert transitions_of(world, ROBOT) == ["configure", "activate"]
    assert ended.cause == f"{ROBOT}: does not tell its state within 2 s"
    assert (ROBOT, signal.SIGINT) in world.signals


JOY = replace(process("joystick"), node="obelisk_joystick", has_lifecycle=False)


def test_a_process_without_a_life_cycle_is_only_started_watched_and_signalled() -> None:
    world = World(plan=Plan(name="s", processes=(*PLAN.processes, JOY)))
    ended = world.run()
    assert ended == Ended(exit_code=0, cause="")
    assert not transitions_of(world, JOY.full_name)
    assert [n for node, n in world.signals if node == JOY.full_name] == [signal.SIGINT]


def test_the_death_of_a_process_without_a_life_cycle_takes_the_stack_down() -> None:
    died = ProcessEnded(node=JOY.full_name, code=1)
    world = World(plan=Plan(name="s", processes=(*PLAN.processes, JOY)), later=deque([died]))
    assert world.run(duration_s=None).cause == f"{JOY.full_name}: the process exited with code 1"


def test_a_process_that_knows_nothing_of_sigint_ends_in_order_by_it() -> None:
    world = World(plan=Plan(name="s", processes=(JOY,)), deaf_to={(JOY.full_name, signal.SIGINT)})
    world.later.append(ProcessEnded(node=JOY.full_name, code=-signal.SIGINT))
    world.later.appendleft(StopAsked(reason="SIGTERM"))
    assert world.run(duration_s=None).exit_code == 0


def test_a_stop_during_the_bring_up_ends_the_wait_at_once() -> None:
    world = World(silent={(ROBOT, "configure")}, mute={ROBOT})
    world.later.append(StopAsked(reason="SIGINT"))
    ended = world.run()
    assert ended.exit_code == 0
    assert world.now == 2.0  # the question for its state
    assert world.phases == ["starting", "ready", "stopping", "stopped"]


def test_a_second_stop_skips_the_transitions_that_are_left_and_shortens_the_grace() -> None:
    again = StopAsked(reason="SIGINT", is_urgent=True)
    world = World(
        silent={(CONTROLLER, "deactivate")},
        deaf_to={(ROBOT, signal.SIGINT), (ROBOT, signal.SIGTERM)},
        later=deque([again, 1.0, again]),
    )
    world.run(duration_s=None)
    assert transitions_of(world, CONTROLLER) == ["configure", "activate", "deactivate"]
    assert (ESTIMATOR, "deactivate") not in world.done
    assert (ROBOT, signal.SIGKILL) in world.signals
    assert world.now == 1.0 + 2 * 0.5


def test_two_signals_at_once_are_one_request() -> None:
    stop = StopAsked(reason="SIGTERM", is_urgent=True)
    world = World(silent={(CONTROLLER, "deactivate")}, later=deque([stop, stop]))
    world.run(duration_s=None)
    assert transitions_of(world, ROBOT)[2:] == ["deactivate", "cleanup", "shutdown"]


def test_a_stop_that_is_not_urgent_hurries_nobody() -> None:
    stop = StopAsked(reason="SIGHUP")
    world = World(silent={(CONTROLLER, "deactivate")}, later=deque([stop, 1.0, stop]))
    world.run(duration_s=None)
    assert (ROBOT, "deactivate") in world.done


def test_a_fault_in_a_transition_that_was_asked_for_elsewhere_leaves_the_stack_up() -> None:
    fault = Failed(node=ROBOT, fault="on_configure: x", transition="configure")
    world = World(later=deque([fault]))
    ended = world.run(until="none")
    assert ended.exit_code == 0
    assert fault in world.told
    assert world.now == 5.0


def test_a_signal_without_a_name_is_told_by_its_number() -> None:
    assert ProcessEnded(node=ROBOT, code=-40).how == "the process was ended by signal 40"
