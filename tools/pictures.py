"""Makes the pictures of the documents, `docs/pictures/`.

Those of the design, of a graph and of findings are made of the code alone and held to it by a test.
With `--live` a stack is started and looked at: what `obk launch` shows, the monitor, the page
(needs the extras `monitor` and `web`, and Chromium). `--check` writes nothing and fails where a
picture of the first kind is stale.
"""

import re
import sys
from collections.abc import Sequence
from io import StringIO
from itertools import pairwise
from pathlib import Path

from diagrams import Arrow, Box, Frame, draw
from generated import ROOT, bring_up_to_date
from rich.console import Console
from rich.text import Text

from obk_cli.emit.graph import graph_of
from obk_cli.emit.svg import emit_svg
from obk_cli.pipeline import Options, compile_config, compile_source
from obk_cli.report.text import report_text, summary
from obk_cli.source import SourceFile

__all__ = ["PICTURES", "STAGES", "generated_files", "main", "terminal", "without_fonts"]

PICTURES = ROOT / "docs" / "pictures"
DUMMY = ROOT / "examples" / "dummy"
MISTAKES = {
    "msg_type: PositionSetpoint}\n  subscribers": "msg_type: PositionSetpiont}\n  subscribers",
    "tip_acc_sensor: acc": "tip_ac_sensor: acc",
    "topic: /obelisk/dummy/est, msg_type: EstimatedState}\n  timers": (
        "topic: /obelisk/dummy/estimate, msg_type: EstimatedState}\n  timers"
    ),
}
"""What is written in the dummy's config, and what it becomes where mistakes are shown."""

STAGES = (
    Box(name="stack.yaml", lines=("text, with its includes",), column=0, row=1, kind="data"),
    Box(name="parse", lines=("text to a tree;", "every value has its place"), column=1, row=1),
    Box(name="resolve", lines=("includes, ${VARIABLES},", "--set, paths"), column=2, row=1),
    Box(name="read", lines=("tree to a typed config",), column=3, row=1),
    Box(name="check", lines=("wiring, types, models,", "packages, code"), column=4, row=1),
    Box(name="lower", lines=("config to a plan;", "cannot fail"), column=5, row=1),
    Box(
        name="plan",
        lines=("processes, parameters,", "promises, order"),
        column=6,
        row=1,
        kind="data",
    ),
    Box(
        name="adapters",
        lines=("MuJoCo's model, packages,", "files of this machine"),
        column=3.5,
        row=0,
        kind="outside",
    ),
    Box(name="code", lines=("nodes' Python source,", "read and not run"), column=4.5, row=0),
    Box(
        name="diagnostics",
        lines=("code, sentence, place,", "help, cure"),
        column=3,
        row=2,
        kind="data",
    ),
    Box(name="report", lines=("text, JSON, SARIF,", "GitHub"), column=4, row=2, kind="result"),
    Box(
        name="emit",
        lines=("parameters, launch file,", "pictures, JSON"),
        column=6,
        row=0,
        kind="result",
    ),
    Box(name="launch", lines=("a running stack",), column=6, row=2, kind="result"),
)
SPINE = ("stack.yaml", "parse", "resolve", "read", "check", "lower", "plan")
STAGE_ARROWS = (
    *(Arrow(start=a, end=b) for a, b in pairwise(SPINE)),
    *(Arrow(start=name, end="diagnostics") for name in ("parse", "resolve", "read", "check")),
    Arrow(start="adapters", end="check"),
    Arrow(start="code", end="check"),
    Arrow(start="diagnostics", end="report"),
    Arrow(start="plan", end="emit"),
    Arrow(start="plan", end="launch"),
)

RUNNING = (
    Box(
        name="other terminals",
        lines=("obk ps, lifecycle, stop,", "monitor, web"),
        column=0,
        row=1.3,
        kind="outside",
    ),
    Box(
        name="screen",
        lines=("log and status; a queue", "that drops and counts"),
        column=1.2,
        row=0.3,
    ),
    Box(name="supervisor", lines=("the one thread", "that decides"), column=2.2, row=1.3),
    Box(name="control.sock", lines=("a line of JSON,", "a line back"), column=1.2, row=1.3),
    Box(
        name="journal",
        lines=("run.json, events.jsonl,", "a log for each node"),
        column=1.2,
        row=2.3,
    ),
    Box(
        name="ROS thread",
        lines=("transitions, states,", "pulse, /diagnostics"),
        column=2.2,
        row=0.3,
    ),
    Box(
        name="output readers",
        lines=("a thread for each node,", "which always reads"),
        column=2.2,
        row=2.3,
    ),
    Box(
        name="warden",
        lines=("parent of all processes;", "ends them with the launcher"),
        column=3.5,
        row=1.3,
        kind="stage",
    ),
    Box(name="robot", lines=("hardware or MuJoCo",), column=4.8, row=0.3, kind="result"),
    Box(name="estimation", lines=("sensors to a state",), column=4.8, row=1.3, kind="result"),
    Box(name="control", lines=("state to commands",), column=4.8, row=2.3, kind="result"),
)
RUNNING_ARROWS = (
    Arrow(start="other terminals", end="control.sock", is_both_ways=True),
    Arrow(start="control.sock", end="supervisor", is_both_ways=True),
    Arrow(start="supervisor", end="screen"),
    Arrow(start="supervisor", end="journal"),
    Arrow(start="ROS thread", end="supervisor", is_both_ways=True),
    Arrow(start="output readers", end="supervisor"),
    Arrow(start="supervisor", end="warden", label="start, end"),
    Arrow(start="warden", end="robot"),
    Arrow(start="warden", end="estimation"),
    Arrow(start="warden", end="control"),
    Arrow(
        start="ROS thread", end="robot", label="ROS 2: get_state, change_state", is_both_ways=True
    ),
    Arrow(start="control", end="output readers", label="what nodes print"),
)
RUNNING_FRAMES = (
    Frame(
        title="obk launch",
        names=("screen", "control.sock", "journal", "supervisor", "ROS thread", "output readers"),
    ),
    Frame(title="a process each", names=("robot", "estimation", "control")),
)


def generated_files() -> dict[Path, str]:
    """Path -> content of the pictures that are made of the code alone."""
    return {
        PICTURES / "dummy.svg": _graph(),
        PICTURES / "validate.svg": _findings(),
        PICTURES / "stages.svg": draw("The stages of the compiler", STAGES, STAGE_ARROWS),
        PICTURES / "running.svg": draw("A running stack", RUNNING, RUNNING_ARROWS, RUNNING_FRAMES),
    }


def terminal(text: str, title: str, columns: int) -> str:
    """A picture of a terminal that shows a text with its colours."""
    console = Console(record=True, width=columns, file=StringIO())
    console.print(Text.from_ansi(text.rstrip()))
    return without_fonts(console.export_svg(title=title, unique_id="terminal"))


def without_fonts(picture: str) -> str:
    """A picture of rich's, but for the fonts that it would load from elsewhere."""
    own = re.sub(r"@font-face \{.*?\}\s*", "", picture, flags=re.DOTALL)
    return "\n".join(line.rstrip() for line in own.splitlines()) + "\n"


def _options() -> Options:
    return Options(environment={}, working_folder=DUMMY, ignore=("OBK4", "OBK204", "OBK507"))


def _graph() -> str:
    plan = compile_config(str(DUMMY / "dummy_new.yaml"), _options()).plan
    assert plan is not None
    return emit_svg(graph_of(plan))


def _findings() -> str:
    text = (DUMMY / "dummy_new.yaml").read_text(encoding="utf-8")
    for right, wrong in MISTAKES.items():
        assert text.count(right) == 1, right
        text = text.replace(right, wrong)
    outcome = compile_source(SourceFile.of("stack.yaml", text), _options())
    said = report_text(outcome.diagnostics, colour=True)
    last = summary(["stack.yaml"], outcome.diagnostics, colour=True)
    return terminal(f"$ obk validate stack.yaml\n{said}\n\n{last}", "obk validate", 108)


def main(arguments: Sequence[str]) -> int:
    """Make the pictures, or with `--check` name those that are stale; the process's exit code."""
    if arguments == ["--live"]:
        from live_pictures import make_live_pictures

        make_live_pictures()
        return 0
    return bring_up_to_date(generated_files(), [], arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
