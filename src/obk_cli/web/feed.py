"""Snapshots of a running stack for the pages, updated by a thread that follows the stack.

Any thread can read the latest snapshot; the thread that follows the stack never waits for a page.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from obk_cli.emit.graph import graph_of
from obk_cli.emit.graphviz import emit_svg
from obk_cli.errors import CommandFailedError
from obk_cli.monitor.model import StackView, Views
from obk_cli.plan.plan import Plan
from obk_cli.runs.folder import plan_of_run

__all__ = ["Feed", "Snapshot", "live_picture"]

STOP_S: Final = 5.0
"""Limit for stopping the thread [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """What the page shows at a given time."""

    number: int = 0
    """Increases with each snapshot."""
    view: StackView | None = None
    """The last stack that was seen; None if there was none yet."""
    is_waiting: bool = True
    """Whether no stack is running."""
    picture: str = ""
    """The graph as SVG; empty if it cannot be drawn."""


class Feed:
    """Follows a stack in its own thread."""

    def __init__(self, follower: Views, runs: Path, on_end: Callable[[], None]) -> None:
        """Create the thread without starting it.

        Args:
            follower: yields the views of the stack.
            runs: the folder of all runs.
            on_end: called in the thread when it ends, for any reason.
        """
        self._follower = follower
        self._runs = runs
        self._on_end = on_end
        self._snapshot = Snapshot()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._watch, name="watching", daemon=True)

    @property
    def snapshot(self) -> Snapshot:
        """The latest snapshot."""
        return self._snapshot

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread.

        Raises:
            ObkError: the thread had failed before.
        """
        self._follower.stop()
        self._thread.join(STOP_S)
        if self._error is not None:
            raise self._error

    def _watch(self) -> None:
        try:
            for view in self._follower.views():
                self._snapshot = self._next(view)
        except Exception as error:  # raised again by `stop`
            self._error = error
        finally:
            self._on_end()

    def _next(self, view: StackView | None) -> Snapshot:
        before = self._snapshot
        if view is None:
            return replace(before, number=before.number + 1, is_waiting=True)
        is_same = before.view is not None and before.view.run == view.run
        return Snapshot(
            number=before.number + 1,
            view=view,
            is_waiting=view.has_ended,
            picture=before.picture if is_same else self._picture(view.run),
        )

    def _picture(self, run: str) -> str:
        return live_picture(plan_of_run(self._runs / run)) if run else ""


def live_picture(plan: Plan) -> str:
    """An SVG with boxes for a page to fill; empty without nodes, or if Graphviz cannot draw it.

    The page then has no panel for it, but otherwise works.
    """
    try:
        return emit_svg(graph_of(plan), is_live=True) if plan.nodes else ""
    except CommandFailedError:
        return ""
