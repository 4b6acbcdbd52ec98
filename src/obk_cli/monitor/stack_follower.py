"""Which stack is watched, and its views in a row: until it ends, and from when another one begins.

In: where to look. Out: a `StackView` each period, None while nothing runs. ROS is loaded when the
first view is asked for, in the thread that asks.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event
from typing import Final, Protocol

from obelisk_spec.suggestions import did_you_mean
from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.introspect.lifecycle import Asked, change_states
from obk_cli.introspect.target import DOMAIN, GraphTarget, target_of
from obk_cli.monitor.model import StackView
from obk_cli.monitor.observers import ElsewhereObserver, Observer
from obk_cli.ros.environment import RosEnvironment
from obk_cli.ros.participant import RosLook, open_look
from obk_cli.runs.folder import Run, runs_folder
from obk_cli.runs.protocol import ChangeAnswer
from obk_cli.runs.registry import live_folders

__all__ = ["Target", "Watcher"]

QUIET_S: Final = 0.3
"""In which no more nodes are told of where those of another host are looked for [s]."""
SLICE_S: Final = 0.1
"""In which a watcher that is to stop does so [s]."""


class _Observer(Protocol):
    def turn_for(self, seconds: float) -> None: ...

    def view(self) -> StackView: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """What a user wants to watch."""

    environment: RosEnvironment
    """As it was found: watching puts one of its own into effect."""
    domain: int | None = None
    """None: that of ROS_DOMAIN_ID, else of the stack."""
    run: str | None = None
    """A config's name or a run folder's; None: whatever runs there."""

    def place(self) -> GraphTarget:
        """Where it is now."""
        if self.run is None or self.domain is not None:
            return target_of(self.environment, self.domain)
        live = live_folders(runs_folder(self.environment.variables))
        meant = (run.domain for folder, run in live.items() if self._is_meant(folder, run))
        return target_of(self.environment, next(meant, None))

    def nobody(self) -> CommandFailedError:
        """The error that nothing of what is meant runs."""
        place = self.place()
        names = sorted({run.name for run in place.runs.values()})
        if self.run is None or not names:
            return place.nobody()
        return CommandFailedError(
            f"no stack `{self.run}` runs in the ROS domain {place.domain}",
            help=did_you_mean(self.run, names),
        )

    def choose(self, place: GraphTarget) -> tuple[Path, Run] | None:
        """The run there that is meant; None: no launcher of this host runs one.

        Raises:
            MisuseError: several stacks run there, and none was named.
        """
        runs = [(folder, run) for folder, run in place.runs.items() if self._is_meant(folder, run)]
        names = sorted({run.name for _, run in runs})
        if len(names) > 1:
            raise MisuseError(
                f"several stacks run in the ROS domain {place.domain}: {', '.join(names)}",
                help="choose one with `--run NAME`",
            )
        # Two launchers of one config: its devices. Whoever leads knows of all nodes.
        return max(runs, key=lambda one: one[1].leads, default=None)

    def change(self, view: StackView, verb: str, nodes: tuple[str, ...]) -> ChangeAnswer:
        """Take nodes of a view's stack through a transition.

        Args:
            view: the stack as it was seen.
            verb: `activate`, ...
            nodes: full names; none: the whole stack.

        Raises:
            ObkError: see `change_states`.
        """
        variables = {**self.environment.variables, DOMAIN: str(view.domain)}
        environment = replace(self.environment, variables=variables)
        return change_states(environment, verb, Asked(names=nodes, run=view.run or None))

    def _is_meant(self, folder: Path, run: Run) -> bool:
        return self.run in (None, run.name, folder.name)


class Watcher:
    """Watches one stack at a time."""

    def __init__(
        self,
        target: Target,
        with_types: Callable[[GraphTarget], GraphTarget],
        period_s: float,
        beside: Callable[[RosLook], None] = lambda _: None,
    ) -> None:
        """Begin with nothing.

        Args:
            target: what to watch.
            with_types: makes the message types of a place's stacks known to this process.
            period_s: between two views [s].
            beside: is called several times a second with the participant that watches.
        """
        self._target = target
        self._with_types = with_types
        self._period_s = period_s
        self._beside = beside
        self._stop = Event()

    def stop(self) -> None:
        """End the views soon; from any thread."""
        self._stop.set()

    def views(self) -> Iterator[StackView | None]:
        """A view each period, None while nothing runs; without end unless it is stopped.

        Raises:
            CommandFailedError: there is no ROS.
            MisuseError: several stacks may be meant.
        """
        while not self._stop.is_set():
            place = self._target.place()
            chosen = self._target.choose(place)
            if chosen is not None:
                yield from self._of_run(place, *chosen)
            elif self._target.run is None:
                yield from self._of_graph(place)
            else:
                yield None
                self._stop.wait(self._period_s)

    def _of_run(self, place: GraphTarget, folder: Path, run: Run) -> Iterator[StackView]:
        with open_look(self._with_types(place).environment) as look:
            observer = Observer(folder, run, look)
            while not self._stop.is_set():
                view = self._next(observer, look)
                yield view
                if view.has_ended:
                    return

    def _of_graph(self, place: GraphTarget) -> Iterator[StackView | None]:
        """Of nodes without a launcher here, until one begins."""
        with open_look(self._with_types(place).environment) as look:
            look.settle((), QUIET_S, self._period_s)
            observer = ElsewhereObserver(look)
            while not self._stop.is_set():
                view = self._next(observer, look)
                yield view if view.nodes else None
                if self._target.choose(self._target.place()) is not None:
                    return

    def _next(self, observer: _Observer, look: RosLook) -> StackView:
        left_s = self._period_s
        while left_s > 0 and not self._stop.is_set():
            observer.turn_for(min(SLICE_S, left_s))
            left_s -= SLICE_S
            self._beside(look)
        return observer.view()
