"""The live table of a running stack in a terminal, drawn by textual.

A thread that follows the stack delivers views. Transitions requested by the user run in another
thread, so the screen never blocks.
"""

import asyncio
import signal
import threading
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import ClassVar, Final

from rich.text import Text
from textual import on
from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.containers import VerticalScroll
from textual.message import Message
from textual.widgets import Input, Static

from obk_cli.errors import ObkError
from obk_cli.introspect.tuning import TunableParameter
from obk_cli.launch.event_lines import short_name
from obk_cli.monitor.model import StackView, Views
from obk_cli.monitor.parameters import ParameterRow, ParameterTable, Tuner, field_text
from obk_cli.monitor.table import (
    TableLine,
    age_line,
    head_line,
    log_lines,
    node_lines,
    topic_lines,
)
from obk_cli.runs.protocol import ChangeAnswer
from obk_cli.terminal import plain

__all__ = ["MonitorApp", "Views", "run_monitor"]

Change = Callable[[StackView, str, tuple[str, ...]], ChangeAnswer]
"""Takes nodes (full names) of a view's stack through a transition; no names: the whole stack."""

VERBS: Final = {
    "a": ("activate",),
    "d": ("deactivate",),
    "c": ("configure",),
    "x": ("cleanup",),
    "r": ("deactivate", "cleanup", "configure", "activate"),
}
"""Key -> transitions."""
RESET: Final = "r"
"""While parameters are shown, this key does not trigger a transition."""
MOVING: Final = "activate"
SEARCHING: Final = "looking for a stack ..."
WAITING: Final = "no stack is running; waiting for one (`obk launch`)"
KEYS: Final = "a activate  d deactivate  r restart  p parameters  / filter  ? help  q quit"
TUNING_KEYS: Final = "left, right change  Enter type a value  r reset  Esc back"
READ_EVERY: Final = 3
"""Number of views between two reads of the parameters, which others may have changed."""
HELP: Final = (
    "up, down    select a node; `all nodes` is the stack",
    "a  c        activate, configure",
    "d  x        deactivate, clean up",
    "r           restart: deactivate, clean up, configure, activate",
    "p           parameters of the node or the stack: left and right move a slider, Enter asks",
    "            for a value, r restores the config's; up, down select; Esc closes",
    "/           show only log lines that contain these words; Esc shows all",
    "q           quit; the stack keeps running",
    "!           a topic more than 10 % off the rate in the config",
    "+           shared process: CPU and RSS include all its nodes",
    "last ms     since the last message;   age ms, age p99   by stamps: median, p99",
)


class ViewReceived(Message):
    """A new view; None: no stack is running."""

    def __init__(self, view: StackView | None) -> None:
        self.view = view
        super().__init__()


class FollowFailed(Message):
    """The stack cannot be followed any further."""

    def __init__(self, error: Exception) -> None:
        self.error = error
        super().__init__()


class ChangeProgress(Message):
    """A requested transition started, ended or failed."""

    def __init__(self, text: str, *, is_done: bool) -> None:
        self.text = text
        self.is_done = is_done
        super().__init__()


class ParametersRead(Message):
    """The nodes have reported their parameters."""

    def __init__(self, found: Mapping[str, tuple[TunableParameter, ...]]) -> None:
        self.found = found
        super().__init__()


def run_monitor(follower: Views, change: Change, tuner: Tuner) -> None:
    """Show the live table until the user quits.

    Args:
        follower: delivers the views.
        change: executes transitions.
        tuner: reads and sets parameters.

    Raises:
        Exception: raised by the follower, or by a transition, except for ObkError.
    """
    app = MonitorApp(follower, change, tuner)
    error = app.run()
    app.stop_following()
    if error is not None:
        raise error


class MonitorApp(App[Exception | None]):
    """The live table."""

    AUTO_FOCUS = ""
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    Screen { layout: vertical; overflow: hidden; }
    #head { height: 1; }
    #nodes { height: auto; max-height: 34%; margin-top: 1; scrollbar-size: 0 0; }
    #topics { height: auto; max-height: 45%; margin-top: 1; scrollbar-size: 0 0; }
    #log { height: 1fr; margin-top: 1; scrollbar-size: 0 0; }
    #filter, #value { display: none; height: 1; border: none; padding: 0; }
    #message { height: 1; }
    #keys { height: 1; text-style: dim; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        *(Binding(key, f"ask('{key}')", show=False) for key in VERBS),
        Binding("up,k", "move(-1)", show=False),
        Binding("down,j", "move(1)", show=False),
        Binding("p", "tune", show=False),
        Binding("left,h", "nudge(-1)", show=False),
        Binding("right,l", "nudge(1)", show=False),
        Binding("enter", "type_value", show=False),
        Binding("y", "confirm", show=False),
        Binding("n", "drop", show=False),
        Binding("escape", "leave", show=False, priority=True),
        Binding("slash", "filter", show=False),
        Binding("question_mark", "help", show=False),
        Binding("q", "quit", show=False),
        Binding("ctrl+c", "quit", show=False, priority=True),
    ]

    def __init__(self, follower: Views, change: Change, tuner: Tuner) -> None:
        """Create the app; it follows nothing before it runs.

        Args:
            follower: delivers the views.
            change: executes transitions.
            tuner: reads and sets parameters.
        """
        super().__init__()
        self._follower = follower
        self._change = change
        self._tuner = tuner
        self._table: ParameterTable | None = None
        """The parameters on the screen; None if they are not shown."""
        self._since_read = 0
        """Number of views since the parameters were read."""
        self._thread = threading.Thread(target=self._take_views, daemon=True)
        self._view: StackView | None = None
        self._has_received = False
        self._chosen = ""
        """The full name of the selected node; empty: the stack."""
        self._to_confirm: tuple[StackView, str, tuple[str, ...]] | None = None
        """The stack, key and nodes that wait for the user's confirmation."""
        self._is_busy = False
        self._part = ""
        self._shows_help = False

    def compose(self) -> ComposeResult:
        """Lay out the parts from top to bottom."""
        yield Static(id="head")
        for name in ("nodes", "topics", "log"):
            with VerticalScroll(id=name, can_focus=False):
                yield Static(id=f"{name}_text")
        yield Input(id="filter", placeholder="filter words; Enter applies, Esc clears")
        yield Input(id="value", placeholder="new value; Enter sets it, Esc cancels")
        yield Static(id="message", markup=False)
        yield Static(Text(KEYS), id="keys")

    def on_mount(self) -> None:
        """Start following the stack."""
        for number in (signal.SIGTERM, signal.SIGHUP):
            asyncio.get_running_loop().add_signal_handler(number, self.exit)
        self.set_focus(None)
        self._draw()
        self._thread.start()

    def on_resize(self) -> None:
        """Redraw for the new width."""
        self.call_after_refresh(self._draw)

    def stop_following(self) -> None:
        """Wait until the following thread has closed ROS."""
        self._follower.stop()
        self._thread.join()

    def on_view_received(self, message: ViewReceived) -> None:
        """Show a view; the last view of an ended stack stays visible."""
        self._has_received = True
        is_ended = self._view is not None and self._view.has_ended
        if message.view is not None and (self._view is None or is_ended):
            self._show_message("")  # it was from a time when no stack was running
        if message.view is not None or not is_ended:
            self._view = message.view
        if self._view is None or self._chosen not in (node.node for node in self._view.nodes):
            self._chosen = ""
        self._since_read += 1
        if self._table is not None and self._since_read >= READ_EVERY:
            self._read_parameters()
        self._draw()

    def on_parameters_read(self, message: ParametersRead) -> None:
        """Show the parameters."""
        if self._table is not None:
            self._table = self._table.read(message.found)
            self._draw()

    def on_follow_failed(self, message: FollowFailed) -> None:
        """Exit with the error."""
        self.exit(message.error)

    def on_change_progress(self, message: ChangeProgress) -> None:
        """Show the progress of a requested transition."""
        self._is_busy = not message.is_done
        self._show_message(message.text)

    def action_move(self, step: int) -> None:
        """Select the next or previous item."""
        if self._table is not None:
            self._table = self._table.moved(step)
            self._draw()
            return
        names = ["", *(node.node for node in self._view.nodes)] if self._view else [""]
        place = names.index(self._chosen) + step
        self._chosen = names[max(0, min(place, len(names) - 1))]
        self._draw()

    def action_ask(self, key: str) -> None:
        """Ask the user to confirm transitions; while parameters are shown, `r` resets."""
        if self._table is not None:
            row = self._table.chosen
            if key == RESET and row is not None and row.initial is not None:
                self._set(row, row.initial)
            return
        view = self._view
        if not self._has_received:
            return  # the first line shows it
        if self._is_busy or view is None or view.has_ended:
            self._show_message(
                "wait for the previous one to finish" if self._is_busy else "nothing is running"
            )
            return
        self._to_confirm = (view, key, (self._chosen,) if self._chosen else ())
        who = short_name(self._chosen) if self._chosen else f"all {len(view.nodes)} nodes"
        moves = "; the robot may move" if MOVING in VERBS[key] else ""
        self._show_message(f"{', '.join(VERBS[key])} {who}{moves}?  y / n")

    def action_tune(self) -> None:
        """Show the parameters of the selected node or of the stack, or show the topics again."""
        self._table = ParameterTable() if self._table is None else None
        self._shows_help = False
        self._show_message("")
        if self._table is not None:
            self._read_parameters()
        self._draw()

    def action_nudge(self, steps: int) -> None:
        """Move the slider of the selected parameter."""
        row = self._table.chosen if self._table is not None else None
        text = row.nudged(steps) if row is not None else None
        if row is not None and text is not None:
            self._set(row, text)

    def action_type_value(self) -> None:
        """Let the user type a value for the selected parameter."""
        row = self._table.chosen if self._table is not None else None
        if row is not None:
            box = self.query_one("#value", Input)
            box.value = field_text(row.parameter.value)
            box.display = True
            box.focus()

    def action_confirm(self) -> None:
        """Request the confirmed transitions."""
        if self._to_confirm is None:
            return
        (view, key, nodes), self._to_confirm = self._to_confirm, None
        self._is_busy = True
        threading.Thread(
            target=self._carry_out, args=(view, VERBS[key], nodes), daemon=True
        ).start()

    def action_drop(self) -> None:
        """Cancel the confirmation."""
        if self._to_confirm is not None:
            self._to_confirm = None
            self._show_message("")

    def action_leave(self) -> None:
        """Close what is open: confirmation, help, filter, or selection of a node."""
        box = self.query_one("#filter", Input)
        if self.query_one("#value", Input).display:
            self._close_value()
        elif box.display:
            box.value = ""
            self._close_filter()
        elif self._table is not None:
            self._table = None
        elif self._to_confirm is None and not self._shows_help:
            self._chosen, self._part = "", ""
        self._shows_help = False
        self.action_drop()
        self._draw()

    def action_filter(self) -> None:
        """Let the user type the text that log lines must contain."""
        box = self.query_one("#filter", Input)
        box.display = True
        box.focus()

    def action_help(self) -> None:
        """Toggle between the keys and the panels of topics and log."""
        self._shows_help = not self._shows_help
        self._draw()

    @on(Input.Changed, "#filter")
    def _filter_by(self, event: Input.Changed) -> None:
        self._part = event.value
        self._draw()

    @on(Input.Submitted, "#filter")
    def _close_filter(self) -> None:
        self.query_one("#filter", Input).display = False
        self.set_focus(None)
        self.call_after_refresh(self._draw)

    @on(Input.Submitted, "#value")
    def _take_value(self, event: Input.Submitted) -> None:
        row = self._table.chosen if self._table is not None else None
        self._close_value()
        if row is not None:
            self._set(row, event.value)

    def _close_value(self) -> None:
        self.query_one("#value", Input).display = False
        self.set_focus(None)
        self.call_after_refresh(self._draw)

    def _read_parameters(self) -> None:
        self._since_read = 0
        view = self._view
        if view is not None:
            threading.Thread(target=self._ask_nodes, args=(view,), daemon=True).start()

    def _ask_nodes(self, view: StackView) -> None:
        found = self._tuner.of(view)
        chosen = {n: each for n, each in found.items() if self._chosen in ("", n)}
        self.post_message(ParametersRead(chosen))

    def _set(self, row: ParameterRow, text: str) -> None:
        if self._view is None or self._is_busy:
            return
        self._is_busy = True
        threading.Thread(
            target=self._set_parameter, args=(self._view, row, text), daemon=True
        ).start()

    def _set_parameter(self, view: StackView, row: ParameterRow, text: str) -> None:
        try:
            result = str(self._tuner.set(view, row.node, row.parameter.name, text))
        except ObkError as error:
            result = f"{error.message}; {error.help}" if error.help else error.message
        self._ask_nodes(view)  # first, because the next step starts from these values
        self.post_message(ChangeProgress(result, is_done=True))

    def _take_views(self) -> None:
        try:
            for view in self._follower.views():
                self.post_message(ViewReceived(view))
        except Exception as error:  # raised again after the screen is closed
            self.post_message(FollowFailed(error))

    def _carry_out(
        self, view: StackView, transitions: Sequence[str], nodes: tuple[str, ...]
    ) -> None:
        who = short_name(nodes[0]) if nodes else "all nodes"
        for transition in transitions:
            self.post_message(ChangeProgress(f"{transition} {who} ...", is_done=False))
            try:
                answer = self._change(view, transition, nodes)
                fault = "" if answer.success else answer.why or "no reason given"
            except ObkError as error:
                fault = f"{error.message}; {error.help}" if error.help else error.message
            except Exception as error:  # raised again after the screen is closed
                self.post_message(FollowFailed(error))
                return
            if fault:
                self.post_message(
                    ChangeProgress(f"{transition} {who} failed: {fault}", is_done=True)
                )
                return
        self.post_message(ChangeProgress(f"{', '.join(transitions)} {who}: done", is_done=True))

    def _show_message(self, text: str) -> None:
        # A node's message may have several lines; the first one names the fault.
        self.query_one("#message", Static).update(Text(plain(text.partition("\n")[0])))

    def _draw(self) -> None:
        width, view = self.size.width, self._view
        if view is None:
            text = WAITING if self._has_received else SEARCHING
            self._put("head", [TableLine(text=text, style="bold yellow")])
            for name in ("nodes_text", "topics_text", "log_text"):
                self._put(
                    name, [TableLine(text=line) for line in HELP] if name == "log_text" else []
                )
            return
        age = age_line(view, width)
        self.query_one("#topics").display = not self._shows_help
        table = self._table
        self._put("head", [head_line(view, width)])
        self._put("nodes_text", self._node_rows(view, width))
        topics = [*topic_lines(view, width), *([age] if age else [])]
        self._put("topics_text", topics if table is None else table.lines(width))
        room = max(1, self.query_one("#log").size.height)
        log = log_lines(view, width, self._part)[-room:]
        self._put("log_text", [TableLine(text=line) for line in HELP] if self._shows_help else log)
        keys = KEYS if table is None else TUNING_KEYS
        self.query_one("#keys", Static).update(
            Text(f"{keys}   [{self._part}]" if self._part else keys)
        )
        if table is not None:
            pane = self.query_one("#topics", VerticalScroll)
            self.call_after_refresh(pane.scroll_to, y=max(0, table.cursor + 1 - pane.size.height))

    def _node_rows(self, view: StackView, width: int) -> list[TableLine]:
        """The lines of the nodes, with one for the whole stack, and the cursor."""
        titles, *rows = node_lines(view, width)
        names = ["", *(node.node for node in view.nodes)]
        lines = [TableLine(text="all nodes"), *rows]
        place = names.index(self._chosen)
        lines[place] = TableLine(
            text=lines[place].text.ljust(width), style=f"{lines[place].style} reverse"
        )
        pane = self.query_one("#nodes", VerticalScroll)
        self.call_after_refresh(pane.scroll_to, y=max(0, place + 2 - pane.size.height))
        return [titles, *lines]

    def _put(self, name: str, lines: Iterable[TableLine]) -> None:
        text = Text("\n", no_wrap=True).join(Text(line.text, line.style) for line in lines)
        text.no_wrap = True
        self.query_one(f"#{name}", Static).update(text)
