"""What pages are told of a running stack, kept by a thread that watches it.

In: a watcher's views. Out: the newest of them with its number and picture, for any thread. Pages
take it when they like; watching waits for none of them.
"""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from obk_cli.emit.graph import graph_of
from obk_cli.emit.svg import emit_svg
from obk_cli.errors import CommandFailedError
from obk_cli.monitor.model import StackView, Views
from obk_cli.plan.plan import Plan
from obk_cli.runs.folder import run_plan

__all__ = ["Feed", "Snapshot", "live_picture"]

STOP_S: Final = 5.0
"""In which a watcher stops [s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """What there is to show now."""

    number: int = 0
    """Another one for each moment."""
    view: StackView | None = None
    """Of the last stack there was; None: of none yet."""
    is_waiting: bool = True
    """Whether nothing runs now."""
    picture: str = ""
    """An SVG; empty: there is none of it."""


class Feed:
    """Watches in a thread of its own."""

    def __init__(self, follower: Views, runs: Path, on_end: Callable[[], None]) -> None:
        """Begin with nothing.

        Args:
            watcher: what is watched.
            runs: the folder of all runs.
            on_end: is called in the thread when watching has ended, for whatever reason.
        """
        self._follower = follower
        self._runs = runs
        self._on_end = on_end
        self._snapshot = Snapshot()
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._watch, name="watching", daemon=True)

    @property
    def snapshot(self) -> Snapshot:
        """The newest."""
        return self._snapshot

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def stop(self) -> None:
        """End watching.

        Raises:
            ObkError: it could not go on before.
        """
        self._follower.stop()
        self._thread.join(STOP_S)
        if self._error is not None:
            raise self._error

    def _watch(self) -> None:
        try:
            for view in self._follower.views():
                self._snapshot = self._next(view)
        except Exception as error:  # raised again where it is seen
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
        return live_picture(run_plan(self._runs / run)) if run else ""


def live_picture(plan: Plan) -> str:
    """An SVG whose boxes a page fills; empty without nodes, or if Graphviz cannot draw it.

    The page then has no panel for it: everything else on it still works.
    """
    try:
        return emit_svg(graph_of(plan), is_live=True) if plan.processes else ""
    except CommandFailedError:
        return ""
