"""Make the pictures of the documentation, `docs/pictures/`.

The diagrams, a graph and a list of findings are generated from the code, and a test checks that
they are up to date. `--live` starts a stack and makes pictures of `obk launch`, the monitor and the
web page (needs the `monitor` and `web` extras, and Chromium). `--check` writes nothing and fails if
a picture of the first kind is stale.
"""

import re
import sys
from collections.abc import Sequence
from io import StringIO
from pathlib import Path

from design_drawings import (
    CLOCK_ARROWS,
    CLOCKS,
    LIFECYCLE,
    LIFECYCLE_ARROWS,
    LOCKSTEP,
    LOCKSTEP_ARROWS,
    PACKAGE_ARROWS,
    PACKAGES,
    RUNNING,
    RUNNING_ARROWS,
    RUNNING_FRAMES,
    SIMULATOR,
    SIMULATOR_ARROWS,
    STAGE_ARROWS,
    STAGES,
    TICK,
    TICK_ARROWS,
)
from diagrams import draw
from generated import ROOT, bring_up_to_date
from rich.console import Console
from rich.text import Text

from obk_cli.compiler import Options, compile_config, compile_source
from obk_cli.diagnostics.source import SourceFile
from obk_cli.emit.graph import graph_of
from obk_cli.emit.graphviz import emit_svg
from obk_cli.report import report_text, summary

__all__ = ["PICTURES", "generated_files", "main", "terminal", "without_fonts"]

PICTURES = ROOT / "docs" / "pictures"
DUMMY = ROOT / "examples" / "dummy"
MISTAKES = {
    "msg_type: PositionSetpoint}\n  subscribers": "msg_type: PositionSetpiont}\n  subscribers",
    "tip_acc_sensor: acc": "tip_ac_sensor: acc",
    "topic: /obelisk/dummy/est, msg_type: EstimatedState}\n  timers": (
        "topic: /obelisk/dummy/estimate, msg_type: EstimatedState}\n  timers"
    ),
}
"""Text in the dummy's config -> the mistake that replaces it in the picture of findings."""


def generated_files() -> dict[Path, str]:
    """Path -> content of the pictures that are generated from the code."""
    return {
        PICTURES / "dummy.svg": _graph(),
        PICTURES / "validate.svg": _findings(),
        PICTURES / "stages.svg": draw("The stages of the compiler", STAGES, STAGE_ARROWS),
        PICTURES / "running.svg": draw("A running stack", RUNNING, RUNNING_ARROWS, RUNNING_FRAMES),
        PICTURES / "packages.svg": draw("Packages and imports", PACKAGES, PACKAGE_ARROWS),
        PICTURES / "tick.svg": draw("From a timer to a callback", TICK, TICK_ARROWS),
        PICTURES / "simulator.svg": draw("The simulated robot", SIMULATOR, SIMULATOR_ARROWS),
        PICTURES / "lockstep.svg": draw("The lockstep scheduler", LOCKSTEP, LOCKSTEP_ARROWS),
        PICTURES / "lifecycle.svg": draw("The states of a node", LIFECYCLE, LIFECYCLE_ARROWS),
        PICTURES / "clocks.svg": draw("Which clock is read where", CLOCKS, CLOCK_ARROWS),
    }


def terminal(text: str, title: str, columns: int) -> str:
    """Draw a terminal that shows text in color."""
    console = Console(record=True, width=columns, file=StringIO())
    console.print(Text.from_ansi(text.rstrip()))
    return without_fonts(console.export_svg(title=title, unique_id="terminal"))


def without_fonts(picture: str) -> str:
    """Remove the fonts from a picture by rich, which would be loaded from the network."""
    own = re.sub(r"@font-face \{.*?\}\s*", "", picture, flags=re.DOTALL)
    return "\n".join(line.rstrip() for line in own.splitlines()) + "\n"


def _options() -> Options:
    return Options(variables={}, working_folder=DUMMY, ignore=("OBK4", "OBK204", "OBK507"))


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
    report = report_text(outcome.diagnostics, colour=True)
    last = summary(["stack.yaml"], outcome.diagnostics, colour=True)
    return terminal(f"$ obk validate stack.yaml\n{report}\n\n{last}", "obk validate", 108)


def main(arguments: Sequence[str]) -> int:
    """Make the pictures, or with `--check` list stale ones; return the exit code."""
    if arguments == ["--live"]:
        from live_pictures import make_live_pictures

        make_live_pictures()
        return 0
    return bring_up_to_date(generated_files(), [], arguments)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
