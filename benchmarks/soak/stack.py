"""The stack that is troubled, by `obk` as a user would, and what its launcher reports."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from obk_cli.runs.folder import runs_folder
from obk_cli.runs.registry import live_stacks, select_runs

__all__ = ["Stack"]

OBK: Final = Path(sys.executable).with_name("obk")
WAIT_S: Final = 60.0
"""For a stack to be as it should, or gone [s]; not a promise, but what is not endless."""
ANSWER_S: Final = 20.0
"""For a launcher to say how its stack is [s]."""
PERIOD: Final = re.compile(r"timer_period_sec: ([0-9.]+)")


@dataclass
class Stack:
    """A launcher, those who look on, and what they did wrong."""

    home: Path
    """Of its own; everything is written there."""
    config: Path
    """A copy in there, which is changed."""
    options: Sequence[str] = ()
    """Of `obk launch`."""
    begin: float = field(default_factory=time.monotonic)
    launcher: "subprocess.Popen[bytes] | None" = None
    company: "list[subprocess.Popen[bytes]]" = field(default_factory=list)
    visits: int = 0
    """How many have looked on so far."""
    faults: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, example: Path, home: Path, options: Sequence[str]) -> "Stack":
        """With a copy of an example's folder."""
        shutil.copytree(example.parent, home / "config")
        return cls(home=home, config=home / "config" / example.name, options=options)

    def now(self) -> float:
        """Since the beginning [s]."""
        return time.monotonic() - self.begin

    def blame(self, fault: str) -> None:
        """Note what is not as the rules say."""
        self.faults.append(f"{self.now():.0f} s: {fault}")

    # --- asking ---

    def obk(self, *words: str) -> "subprocess.CompletedProcess[str]":
        """A command to its end."""
        return subprocess.run(
            [OBK, *words],
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=2 * WAIT_S,
            check=False,
        )

    def start(self, *words: str) -> "subprocess.Popen[bytes]":
        """A command that goes on; what it complains of is kept."""
        with (self.home / "complaints.log").open("ab") as complaints:
            return subprocess.Popen(
                [OBK, *words],
                env=self._environment,
                stdout=subprocess.DEVNULL,
                stderr=complaints,
                cwd=self.home,
            )

    def nodes(self) -> dict[str, dict[str, Any]]:
        """What `obk ps` would say of each; empty if nothing runs or answers."""
        runs = select_runs(runs_folder({"OBK_HOME": str(self.home)}))
        stacks = live_stacks(runs, ANSWER_S)
        return {
            node.node: asdict(node)
            for stack in stacks
            if stack.status
            for node in stack.status.nodes
        }

    def leftovers(self) -> list[dict[str, Any]]:
        """Processes of this stack that outlived it."""
        listed = json.loads(self.obk("ps", "--format", "json").stdout)
        # Other stacks of this machine may have the same name, and leave processes while they end.
        mine = {run.name for run in runs_folder({"OBK_HOME": str(self.home)}).glob("*")}
        return [process for process in listed["orphans"] if process["run"] in mine]

    def wait_for(self, what: str, condition: Callable[[], object]) -> bool:
        """Whether something comes to be; a fault where not."""
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            if condition():
                return True
            time.sleep(0.2)
        self.blame(f"never came: {what}")
        return False

    def is_active(self) -> bool:
        """Whether all nodes are."""
        nodes = self.nodes().values()
        return bool(nodes) and all(node["state"] == "active" for node in nodes)

    # --- doing ---

    def launch(self) -> None:
        """Bring it up."""
        self.launcher = self.start("launch", str(self.config), "--quiet", *self.options)
        self.wait_for("a stack that is active", self.is_active)

    def stop(self) -> None:
        """Bring it down, as Ctrl-C does; a stack that stopped cleanly says so."""
        assert self.launcher is not None
        if (code := self._end(self.launcher)) != 0:
            self.blame(f"the launcher ended with {code}")

    def send_company_away(self) -> None:
        """End all who look on."""
        for process in self.company:
            code = self._end(process)
            if code is None or code < 0:
                self.blame(f"ended with {code}: obk {' '.join(map(str, process.args[1:]))}")
        self.company.clear()

    def change_period(self) -> float:
        """Halve or double the first period of the config in turns; the new rate [Hz]."""
        text = self.config.read_text(encoding="utf-8")
        period_s = float(PERIOD.findall(text)[0])
        whole = self.config.with_suffix(".before")
        if whole.exists():
            text, new_s = whole.read_text(encoding="utf-8"), period_s / 2
            whole.unlink()
        else:
            whole.write_text(text, encoding="utf-8")
            new_s = 2 * period_s
            text = PERIOD.sub(f"timer_period_sec: {new_s:g}", text, count=1)
        self.config.write_text(text, encoding="utf-8")
        return 1 / new_s

    def complaints(self) -> list[str]:
        """Last lines of tracebacks that anybody wrote."""
        path = self.home / "complaints.log"
        text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
        found = re.findall(r"Traceback \(most recent call last\):\n(?:[ \t].*\n)*(.*)", text)
        return list(dict.fromkeys(found))

    def _end(self, process: "subprocess.Popen[bytes]") -> int | None:
        """The exit code after a Ctrl-C; None where it had to be killed."""
        process.send_signal(signal.SIGINT)
        try:
            return process.wait(WAIT_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
            return None

    @property
    def _environment(self) -> dict[str, str]:
        own = {"OBK_HOME": str(self.home), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        return {**os.environ, **own}
