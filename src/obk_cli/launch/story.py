"""What is told of a run: what happens, how far the stack got, and its state as that changes."""

from collections.abc import Callable

from obk_cli.launch.events import Phase, StackState, Told
from obk_cli.launch.roster import Roster
from obk_cli.runs.protocol import StackStatus

__all__ = ["Story"]


class Story:
    """The one voice of a run."""

    def __init__(
        self, roster: Roster, clock: Callable[[], float], tell: Callable[[Told], None]
    ) -> None:
        """Begin the run.

        Args:
            roster: what is known of the nodes.
            clock: monotonic time [s].
            tell: takes what happens.
        """
        self._roster = roster
        self._clock = clock
        self._tell = tell
        self._begin = clock()
        self._phase = ""
        self._told_state = ""

    def phase(self, name: str, detail: str = "") -> None:
        """The stack got somewhere."""
        self._phase = name
        self.episode(name, detail)

    def episode(self, name: str, detail: str = "") -> None:
        """Something happens on the way, after which the stack is where it was."""
        self.tell(Phase(name=name, seconds=self._clock() - self._begin, detail=detail))

    def tell(self, event: Told) -> None:
        """Tell what happened, and the stack's state where that has changed with it."""
        self._tell(event)
        self.tell_state()

    def is_moving(self, passes: str) -> None:
        """What the whole stack is in from here on, whatever its nodes are; empty: what they are."""
        self._roster.moving = passes
        self.tell_state()

    def status(self) -> StackStatus:
        """How the stack is."""
        return StackStatus(
            name=self._roster.plan.name,
            state=self._roster.stack_state(),
            phase=self._phase,
            seconds=self._clock() - self._begin,
            nodes=self._roster.status(),
        )

    def tell_state(self) -> None:
        """Tell the stack's state if it has changed."""
        state = self._roster.stack_state()
        if state != self._told_state:
            self._told_state = state
            self._tell(StackState(state=state))
