"""Follow a stack: yield views until it ends, then continue with the next stack that starts.

The follower yields a `StackView` per period, or None while no stack is running. ROS is loaded for
the first view, in the thread that requests it.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Final, Protocol

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect.lifecycle import LifecycleRequest, change_states
from obk_cli.introspect.target import GraphTarget, target_of
from obk_cli.monitor.model import StackView
from obk_cli.monitor.observers import LocalObserver, RemoteObserver
from obk_cli.ros.environment import DOMAIN, RosEnvironment
from obk_cli.ros.participant import RosParticipant, open_participant
from obk_cli.runs.folder import Run, runs_folder
from obk_cli.runs.protocol import ChangeAnswer
from obk_cli.runs.registry import live_folders

__all__ = ["StackFollower", "StackSelector"]

QUIET_S: Final = 0.3
"""Time without a new node after which discovery of another host is complete [s]."""
SLICE_S: Final = 0.1
"""Limit for a follower to stop [s]."""


class Observer(Protocol):
    def turn_for(self, seconds: float) -> None: ...

    def view(self) -> StackView: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class StackSelector:
    """The stack that the user wants to follow."""

    environment: RosEnvironment
    """The user's environment; following applies another one."""
    domain: int | None = None
    """None: ROS_DOMAIN_ID, otherwise that of the stack."""
    run: str | None = None
    """Name of a config or a run folder; None: any."""

    def graph_target(self) -> GraphTarget:
        """The ROS domain of the stack, and the runs in it."""
        if self.run is None or self.domain is not None:
            return target_of(self.environment, self.domain)
        live = live_folders(runs_folder(self.environment.variables))
        domains = (run.domain for folder, run in live.items() if self._matches(folder, run))
        return target_of(self.environment, next(domains, None))

    def no_nodes_error(self) -> CommandFailedError:
        """The error for a stack that is not running."""
        graph_target = self.graph_target()
        names = sorted({run.name for run in graph_target.runs.values()})
        if self.run is None or not names:
            return graph_target.no_nodes_error()
        return CommandFailedError(
            f"no stack `{self.run}` is running in ROS domain {graph_target.domain}",
            help=did_you_mean(self.run, names),
        )

    def find_run(self, graph_target: GraphTarget) -> tuple[Path, Run] | None:
        """The selected run in the domain; None if no launcher on this host runs it.

        Raises:
            MisuseError: several stacks are running there, and none was selected.
        """
        runs = [
            (folder, run) for folder, run in graph_target.runs.items() if self._matches(folder, run)
        ]
        names = sorted({run.name for _, run in runs})
        if len(names) > 1:
            raise MisuseError(
                f"several stacks are running in ROS domain {graph_target.domain}: "
                f"{', '.join(names)}",
                help="choose one with `--run NAME`",
            )
        # Two launchers of one config run its devices. The leading one knows all nodes.
        return max(runs, key=lambda one: one[1].leads, default=None)

    def change(self, view: StackView, verb: str, nodes: tuple[str, ...]) -> ChangeAnswer:
        """Take nodes of a view's stack through a transition.

        Args:
            view: the stack as last seen.
            verb: `activate`, ...
            nodes: full names; empty: the whole stack.

        Raises:
            ObkError: see `change_states`.
        """
        variables = {**self.environment.variables, DOMAIN: str(view.domain)}
        environment = replace(self.environment, variables=variables)
        return change_states(environment, verb, LifecycleRequest(names=nodes, run=view.run or None))

    def _matches(self, folder: Path, run: Run) -> bool:
        return self.run in (None, run.name, folder.name)


class StackFollower:
    """Follows one stack at a time."""

    def __init__(
        self,
        target: StackSelector,
        with_types: Callable[[GraphTarget], GraphTarget],
        period_s: float,
        on_turn: Callable[[RosParticipant], None] = lambda _: None,
    ) -> None:
        """Prepare; following starts with `views`.

        Args:
            target: the stack to follow.
            with_types: makes message types of the target's stacks known to this process.
            period_s: time between two views [s].
            on_turn: called several times per second with the participant.
        """
        self._target = target
        self._with_types = with_types
        self._period_s = period_s
        self._on_turn = on_turn
        self._stop = Event()

    def stop(self) -> None:
        """Stop the views soon; may be called from any thread."""
        self._stop.set()

    def views(self) -> Iterator[StackView | None]:
        """Yield a view per period, or None while no stack is running, until stopped.

        Raises:
            CommandFailedError: ROS is missing.
            MisuseError: several stacks match.
        """
        while not self._stop.is_set():
            graph_target = self._target.graph_target()
            chosen = self._target.find_run(graph_target)
            if chosen is not None:
                yield from self._follow_run(graph_target, *chosen)
            elif self._target.run is None:
                yield from self._follow_graph(graph_target)
            else:
                yield None
                self._stop.wait(self._period_s)

    def _follow_run(self, graph_target: GraphTarget, folder: Path, run: Run) -> Iterator[StackView]:
        with open_participant(self._with_types(graph_target).environment) as participant:
            observer = LocalObserver(folder, run, participant)
            while not self._stop.is_set():
                view = self._next_view(observer, participant)
                yield view
                if view.has_ended:
                    return

    def _follow_graph(self, graph_target: GraphTarget) -> Iterator[StackView | None]:
        """Views of nodes without a launcher on this host, until a launcher starts."""
        with open_participant(self._with_types(graph_target).environment) as participant:
            participant.settle((), QUIET_S, self._period_s)
            observer = RemoteObserver(participant)
            while not self._stop.is_set():
                view = self._next_view(observer, participant)
                yield view if view.nodes else None
                if self._target.find_run(self._target.graph_target()) is not None:
                    return

    def _next_view(self, observer: Observer, participant: RosParticipant) -> StackView:
        left_s = self._period_s
        while left_s > 0 and not self._stop.is_set():
            observer.turn_for(min(SLICE_S, left_s))
            left_s -= SLICE_S
            self._on_turn(participant)
        return observer.view()
