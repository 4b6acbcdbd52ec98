"""Switches the simulated drive on, runs the stack for a while, and switches the drive off again.

`python examples/hardware/demo.py [SECONDS]`. The same by hand takes two terminals: see README.md.
"""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def bound(*command: str | Path) -> list[str | Path]:
    """A command whose program gets SIGTERM when this one ends, by SIGKILL even."""
    return [sys.executable, "-m", "obk_cli.process.child_process", str(os.getpid()), *command]


def launch(seconds: float) -> int:
    """Run the stack to its end; gives `obk launch`'s exit code."""
    obk = Path(sys.executable).with_name("obk")
    config = HERE / "hardware.yaml"
    command = bound(obk, "launch", config, "--duration", f"{seconds:g}")
    with subprocess.Popen(command) as stack:
        try:
            return stack.wait()
        except KeyboardInterrupt:
            # Ctrl-C goes to the whole terminal: the stack is on its way down already.
            return stack.wait()


def main() -> int:
    """Drive on, stack up, stack down, drive off."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    # In a session of its own, so that Ctrl-C ends the stack first and the drive last.
    command = bound(sys.executable, HERE / "device.py")
    with subprocess.Popen(command, start_new_session=True) as drive:
        try:
            code = launch(seconds)
        finally:
            drive.terminate()
    return code or drive.returncode


if __name__ == "__main__":
    sys.exit(main())
