"""Run the stack under test with `obk`, as a user would, and read what its launcher reports."""

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
"""Timeout for a stack to reach a state or to stop [s]; generous, only to end the wait."""
ANSWER_S: Final = 20.0
"""Timeout for a launcher to report the status of its stack [s]."""
STDERR_LOG: Final = "stderr.log"
PERIOD: Final = re.compile(r"timer_period_sec: ([0-9.]+)")


@dataclass
class Stack:
    """A launcher, its observers, and their faults."""

    home: Path
    """The `OBK_HOME` of the stack, to which everything is written."""
    config: Path
    """A copy of the config in `home`, which faults may change."""
    options: Sequence[str] = ()
    """Options of `obk launch`."""
    begin: float = field(default_factory=time.monotonic)
    launcher: "subprocess.Popen[bytes] | None" = None
    observers: "list[subprocess.Popen[bytes]]" = field(default_factory=list)
    observers_started: int = 0
    faults: list[str] = field(default_factory=list)

    @classmethod
    def of(cls, example: Path, home: Path, options: Sequence[str]) -> "Stack":
        """Create a stack with a copy of an example's folder."""
        shutil.copytree(example.parent, home / "config")
        return cls(home=home, config=home / "config" / example.name, options=options)

    def now(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self.begin

    def blame(self, fault: str) -> None:
        """Record a fault of the stack."""
        self.faults.append(f"{self.now():.0f} s: {fault}")

    # --- queries ---

    def obk(self, *words: str) -> "subprocess.CompletedProcess[str]":
        """Run an `obk` command until it ends."""
        return subprocess.run(
            [OBK, *words],
            env=self._environment,
            capture_output=True,
            text=True,
            timeout=2 * WAIT_S,
            check=False,
        )

    def start(self, *words: str) -> "subprocess.Popen[bytes]":
        """Start an `obk` command in the background; its standard error goes to a log."""
        with (self.home / STDERR_LOG).open("ab") as errors:
            return subprocess.Popen(
                [OBK, *words],
                env=self._environment,
                stdout=subprocess.DEVNULL,
                stderr=errors,
                cwd=self.home,
            )

    def nodes(self) -> dict[str, dict[str, Any]]:
        """The status of each node as in `obk ps`; empty if no launcher is running or replies."""
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
        # Other stacks on this machine may have the same name, and have orphans while they stop.
        mine = {run.name for run in runs_folder({"OBK_HOME": str(self.home)}).glob("*")}
        return [process for process in listed["orphans"] if process["run"] in mine]

    def wait_for(self, what: str, condition: Callable[[], object]) -> bool:
        """Wait until a condition is true; record a fault and return False on timeout."""
        end = time.monotonic() + WAIT_S
        while time.monotonic() < end:
            if condition():
                return True
            time.sleep(0.2)
        self.blame(f"timed out waiting for {what}")
        return False

    def is_active(self) -> bool:
        """Whether all nodes are active."""
        nodes = self.nodes().values()
        return bool(nodes) and all(node["state"] == "active" for node in nodes)

    # --- actions ---

    def launch(self) -> None:
        """Launch the stack and wait until it is active."""
        self.launcher = self.start("launch", str(self.config), "--quiet", *self.options)
        self.wait_for("an active stack", self.is_active)

    def stop(self) -> None:
        """Stop the stack as Ctrl-C does; record a fault unless the launcher exits with 0."""
        assert self.launcher is not None
        if (code := self._end(self.launcher)) != 0:
            self.blame(f"the launcher exited with {code}")

    def stop_observers(self) -> None:
        """Stop all observers."""
        for process in self.observers:
            code = self._end(process)
            if code is None or code < 0:
                self.blame(f"{process.args!r} exited with {code}")
        self.observers.clear()

    def change_period(self) -> float:
        """Alternately double and restore the first period in the config; return the rate [Hz]."""
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

    def tracebacks(self) -> list[str]:
        """The last lines of all tracebacks in the log."""
        path = self.home / STDERR_LOG
        text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
        found = re.findall(r"Traceback \(most recent call last\):\n(?:[ \t].*\n)*(.*)", text)
        return list(dict.fromkeys(found))

    def _end(self, process: "subprocess.Popen[bytes]") -> int | None:
        """Stop a process as Ctrl-C does; return its exit code, or None if it had to be killed."""
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
