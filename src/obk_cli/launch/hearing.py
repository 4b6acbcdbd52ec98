"""The one place where a run hears: it takes note, answers what can be answered at once, tells.

What has to be done about what was heard is left to whoever waits for it.
"""

import signal
from collections import deque
from collections.abc import Callable, Iterable
from queue import Empty
from typing import Final, Literal

from obk_cli.launch.asks import ChangeAsked, StatusAsked
from obk_cli.launch.awake import SLICE_S, AwakeClock
from obk_cli.launch.doors import Inbox, Lifecycle, Limits, Processes
from obk_cli.launch.echoes import Echoes
from obk_cli.launch.events import (
    Answered,
    AnswersAgain,
    Evidence,
    Failed,
    Heard,
    Hung,
    ProcessEnded,
    ProcessStarted,
    RateBroken,
    RatesHeard,
    Ready,
    StateAnswered,
    StateSeen,
    StopAsked,
    StrangerSeen,
    Told,
    TransitionBegun,
    TransitionEnded,
)
from obk_cli.launch.failures import Crash, Failure
from obk_cli.launch.newer_lines import newer_lines
from obk_cli.launch.pulse import Pulse
from obk_cli.launch.rates import RateWatch
from obk_cli.launch.roster import Roster
from obk_cli.launch.story import Story
from obk_cli.runs.lifecycle import FINALIZED, TRANSITIONS, UNCONFIGURED
from obk_cli.runs.protocol import ChangeAnswer

__all__ = ["Hearing"]

ONE_REQUEST_S: Final = 0.3
"""Signals this close to the first one belong to it: `timeout` sends two, a closing terminal too."""
LAST_LINES: Final = 20
"""Of what a stuck node wrote before its stack dump, which may be longer than all of them."""
FROM_ELSEWHERE: Final = "every node was shut down from elsewhere"


class Hearing:
    """What a run hears, does first about it, and remembers."""

    def __init__(
        self,
        roster: Roster,
        *,
        processes: Processes,
        lifecycle: Lifecycle,
        inbox: Inbox,
        clock: Callable[[], float],
        tell: Callable[[Told], None],
        limits: Limits,
        strict_rates: bool,
    ) -> None:
        """Begin to hear; see `Supervisor` for the arguments."""
        self.roster = roster
        self.processes = processes
        self.lifecycle = lifecycle
        self.clock = AwakeClock(clock)
        self.limits = limits
        self.pulse = Pulse(limits.hang_s)
        self.crashes: deque[Crash] = deque()
        self.asked: deque[ChangeAsked] = deque()
        """Changes that wait to be made."""
        self.failures: list[Failure] = []
        self.stop: str | None = None
        self.is_going_down = False
        self.is_in_a_hurry = False
        self.busy_with = ""
        """Why no change can be made now, in words that follow "the stack is"; empty: it can."""
        self.lead: str | None = None
        """The state node of the launch that drives this one's nodes."""
        self.story = Story(roster, self.clock, tell)
        self._inbox = inbox
        self._stopping_since: float | None = None
        self._condemned: set[str] = set()
        """Units that are killed on purpose."""
        self.echoes = Echoes()
        self._rates = RateWatch(roster)
        self._strict_rates = strict_rates

    @property
    def may_go_on(self) -> bool:
        """Whether there is no reason to come down."""
        return self.stop is None and not self.failures

    def forget_crashes(self, unit: str, *, hangs_only: bool = False) -> None:
        """Leave out what is not dealt with yet of a process that is dealt with as a whole."""
        self.crashes = deque(
            crash
            for crash in self.crashes
            if crash.unit != unit or (hangs_only and crash.kind != "hung")
        )

    def fail(self, text: str, node: str | None = None) -> None:
        """The stack comes down for this."""
        self.failures.append(Failure(text=text, node=node))

    def goes_down(self) -> None:
        """From here on ends are in order, and nothing is watched."""
        self.is_going_down = True
        self.busy_with = "on its way down"
        self.pulse = Pulse(self.limits.hang_s)
        if self._stopping_since is None:
            self._stopping_since = self.clock()
        self.refuse_changes()

    def refuse_changes(self) -> None:
        """Answer the changes that wait: there is no time for them any more."""
        while self.asked:
            self._refuse(self.asked.popleft())

    def watch(self, nodes: Iterable[str]) -> None:
        """Look after these nodes from now on."""
        self.pulse.watch(nodes, self.clock())

    def request(self, node: str, transition: str, limit_s: float) -> None:
        """Ask a node for a transition; it may be busy with it for so long."""
        self.pulse.heard(node, self.clock(), limit_s)
        self.echoes.expect(node, transition)
        self.roster.in_transition.add(node)
        self.lifecycle.request(node, transition)

    def start(self, unit: str) -> None:
        """Start a process; nothing is known of its nodes any more."""
        self.roster.starts(unit)
        self.echoes.forget(self.roster.units[unit].node_names)
        self.processes.start(self.roster.units[unit])

    def kill(self, unit: str) -> None:
        """End a process that nothing else helps with; its end is no crash."""
        if unit in self.roster.running:
            self._condemned.add(unit)
            self.processes.signal(unit, signal.SIGKILL)

    def give_evidence(self, node: str) -> None:
        """Tell what a stuck node's process wrote last, and where it is stuck."""
        unit = self.roster.unit_of.get(node)
        if unit is None or self.is_in_a_hurry:
            return
        said = self.processes.last_lines(unit)
        self.processes.dump_stack(unit)
        until = self.clock() + self.limits.dump_s
        while self.hear(until):
            pass
        dump = newer_lines(said, self.processes.last_lines(unit))
        self.story.tell(Evidence(node=node, lines=(*said[-LAST_LINES:], *dump)))

    def hear(self, deadline: float | None) -> Heard | Hung | None:
        """The next message or hang, after taking note of it; None at the deadline (monotonic [s]).

        A hang counts as heard: where nobody says anything any more it is all that there is.
        """
        while True:
            now = self.clock()
            if (hung := self._look_after(now)) is not None:
                return hung
            look = self.pulse.next_look(now)
            ends = [end for end in (deadline, look) if end is not None]
            left = min(SLICE_S, max(0.0, min(ends) - now)) if ends else None
            try:
                heard = self._inbox.get(timeout=left)
            except Empty:
                self.clock.waited(now, left)
                if deadline is not None and self.clock() >= deadline:
                    return None
                continue
            self.clock.waited(now, left)
            self._note(heard)
            return heard

    def _look_after(self, now: float) -> Hung | None:
        """Ask for signs of life; those that give none hang. Gives the first of them."""
        hung = [self._hangs(node, seconds) for node, seconds in self.pulse.late(now)]
        for node in self.pulse.due(now):
            self.lifecycle.ask_state(node)
        self._tell_rates(self._rates.silence(now))
        return next((event for event in hung if event is not None), None)

    def _tell_rates(self, news: Iterable[Told]) -> None:
        """Tell news of rates; where promises are strict, one that is broken ends the run."""
        for event in news if not self.is_going_down else ():
            self.story.tell(event)
            if self._strict_rates and isinstance(event, RateBroken):
                self.fail(f"{event.node}: {event.how}", event.node)

    def _hangs(self, node: str, seconds: float) -> Hung | None:
        """Take note of a hang; None: it is known, and nothing follows from its going on."""
        hung = Hung(node=node, seconds=seconds)
        if node == self.lead:
            self.fail(f"the lead {node} has not answered for {seconds:.1f} s")
            return hung
        if node in self.roster.hung:
            return hung if self._is_given_up(hung) else None
        self.roster.hung.add(node)
        self.story.tell(hung)
        self.crashed(node, "hung", f"{node} hangs: no answer for {seconds:.1f} s")
        return hung

    def _is_given_up(self, hung: Hung) -> bool:
        """Whether a node that another launch is to start again has been gone for too long."""
        node, roster = hung.node, self.roster
        if roster.is_here(node) or roster.on_crash(node) != "restart":
            return False
        if hung.seconds <= self.limits.restart_window_s:
            return False
        back = "and the launch of its device has not brought it back"
        self.fail(f"{node} has not answered for {hung.seconds:.0f} s, {back}", node)
        return True

    def crashed(self, node: str, kind: Literal["ended", "hung", "fault"], text: str) -> None:
        """Something happened to a node that its rule `on_crash` is for."""
        unit = self.roster.unit_of.get(node, node)
        self.crashes.append(Crash(unit=unit, kind=kind, text=text, node=node))
        if self.roster.on_crash(unit) == "stop":
            self.fail(text, node)

    def _note(self, heard: Heard) -> None:
        match heard:
            case ProcessStarted():
                self._started(heard)
            case ProcessEnded():
                self._ended(heard)
            case Ready(node=node):
                self._ready(node)
            case Answered(node=node):
                self.roster.in_transition.discard(node)
                self._alive(node)
                self._answered_late(heard)
            case StateAnswered(node=node, state=state):
                self._alive(node)
                self._answered_state(node, state)
            case TransitionBegun(node=node) if node != self.lead:
                self.pulse.heard(node, self.clock(), self.limits.transition_s)
            case StateSeen(node=node) if node != self.lead:
                self._alive(node)
                self._seen(heard)
            case Failed(node=node) if node != self.lead:
                self._failed(heard)
            case RatesHeard():
                self._tell_rates(self._rates.heard(heard, self.clock()))
            case _:
                self._note_request(heard)

    def _note_request(self, heard: Heard) -> None:
        """What comes from outside."""
        match heard:
            case StopAsked():
                self._stop_asked(heard)
            case StatusAsked():
                heard.reply(self.story.status())
            case StrangerSeen(topic=topic, node=node):
                if not self.is_going_down:
                    self.fail(f"{node}, which is not of this stack, publishes on {topic} too")
            case ChangeAsked():
                if self.busy_with:
                    self._refuse(heard)
                else:
                    self.asked.append(heard)
            case _:
                pass

    def _alive(self, node: str) -> None:
        now = self.clock()
        self.pulse.heard(node, now)
        if node in self.roster.hung and not self.is_going_down:
            self.roster.hung.discard(node)
            self.story.tell(AnswersAgain(node=node))
            if node not in self.roster.in_transition:
                # It may run in a new process of another launch.
                self.roster.states.pop(node, None)

    def _answered_late(self, heard: Answered) -> None:
        """Of a node that was given up: it is not to stay further up than it is wanted."""
        node, transition = heard.node, TRANSITIONS[heard.transition]
        asked = self.echoes.when_asked(heard)
        if asked is None or not heard.success:
            return
        self.roster.states[node] = transition.goal
        took_s = self.clock() - asked
        self.story.tell(
            TransitionEnded(node=node, transition=transition.name, result="reached", seconds=took_s)
        )
        is_wanted = self.roster.wanted.get(node) == transition.goal
        if transition.is_up and transition.undo and not is_wanted and not self.is_going_down:
            self.story.episode("rolling back", node)
            back = ChangeAsked(transition=transition.undo, nodes=(node,), reply=lambda _: None)
            self.asked.append(back)

    def _answered_state(self, node: str, state: str) -> None:
        """What a node says of itself when asked; in the middle of a transition it is no news."""
        known = self.roster.states
        if node == self.lead or node in self.roster.in_transition:
            return
        if self.is_going_down or node not in known:
            known[node] = state
            self.story.tell_state()

    def _ready(self, node: str) -> None:
        if node == self.lead:
            self.watch({node})
            return
        if not self.roster.is_here(node):
            self.lifecycle.ask_state(node)
        elif node not in self.roster.ready:
            self.roster.states[node] = UNCONFIGURED
        self.roster.ready.add(node)

    def _started(self, heard: ProcessStarted) -> None:
        self.roster.pids[heard.process] = heard.pid
        self.story.tell(heard)
        # Not before: a node of the same name might be there that is not ours.
        names = set(self.roster.units[heard.process].node_names)
        self.lifecycle.watch(names & self.roster.with_lifecycle)

    def _ended(self, heard: ProcessEnded) -> None:
        unit = heard.process
        names = self.roster.units[unit].node_names
        is_early = self.is_early(unit)
        has_lifecycle = self.roster.with_lifecycle.issuperset(names)
        # What is left of such a process is Python's end, which a busy machine may draw out.
        is_over = has_lifecycle and self.roster.are_all(names, FINALIZED)
        self.roster.ended(unit)
        self.pulse.forget(names)
        ends = {0} | ({-signal.SIGTERM} if is_early else set())
        if is_over or not has_lifecycle:
            ends |= {-signal.SIGINT, -signal.SIGTERM}
        if unit in self._condemned:
            self._condemned.discard(unit)
        elif not self.is_going_down:
            self.story.tell(heard)
            self.crashed(self.roster.culprit(heard), "ended", f"{unit}: {heard.how}")
        elif heard.code not in ends:
            self.story.tell(heard)
            self.fail(f"{unit}: {heard.how}", self.roster.culprit(heard))

    def is_early(self, unit: str) -> bool:
        """Whether a process's nodes are not there yet, nor handle signals in their own way."""
        names = self.roster.with_lifecycle.intersection(self.roster.units[unit].node_names)
        return not names <= self.roster.ready

    def _seen(self, heard: StateSeen) -> None:
        """A node's state changed: by what was asked here, or from elsewhere."""
        if self.echoes.is_one(heard) or self.is_going_down:
            return
        if self.roster.is_present(heard.node):
            self.roster.states[heard.node] = heard.state
        if self.lead is not None and not self.pulse.watches(self.lead):
            self.watch({self.lead})  # Whoever moved the node is there.
        if heard.transition:
            self.roster.wanted[heard.node] = heard.state
        self.story.tell(heard)
        # Without a transition it is the end of a failure, which is told by itself.
        here = self.roster.here() - self.roster.lost
        if heard.transition and self.roster.are_all(here, FINALIZED):
            self.stop = self.stop or FROM_ELSEWHERE

    def _failed(self, heard: Failed) -> None:
        """A fault of the node's own is a crash; a transition's is whose who asked."""
        if self.echoes.is_one(heard) or self.is_going_down:
            return
        self.story.tell(heard)
        if not heard.transition and self.roster.is_present(heard.node):
            self.roster.states[heard.node] = UNCONFIGURED
            first = heard.fault.splitlines()[0] if heard.fault else "no reason given"
            self.crashed(heard.node, "fault", f"{heard.node} failed: {first}")

    def _stop_asked(self, heard: StopAsked) -> None:
        """Stop; asked again, and not just by one who sends two signals at once, hurry."""
        if self._stopping_since is None:
            self._stopping_since = self.clock()
        elif heard.is_urgent and self.clock() - self._stopping_since > ONE_REQUEST_S:
            self.is_in_a_hurry = True
        self.stop = self.stop or heard.reason

    def _refuse(self, asked: ChangeAsked) -> None:
        asked.reply(ChangeAnswer(success=False, why=f"the stack is {self.busy_with}"))
