"""Switch the simulated drive on, run the stack for a while, and switch the drive off again.

Usage: `python examples/hardware/demo.py [SECONDS]`. By hand, it takes two terminals: see README.md.
"""

import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).parent


def bound(*command: str | Path) -> list[str | Path]:
    """A command whose program receives SIGTERM when this program ends, even by SIGKILL."""
    return [sys.executable, "-m", "obk_cli.process.child_process", str(os.getpid()), *command]


def launch(seconds: float) -> int:
    """Run the stack until it ends; return the exit code of `obk launch`."""
    obk = Path(sys.executable).with_name("obk")
    config = HERE / "hardware.yaml"
    command = bound(obk, "launch", config, "--duration", f"{seconds:g}")
    with subprocess.Popen(command) as stack:
        try:
            return stack.wait()
        except KeyboardInterrupt:
            # Ctrl-C goes to the whole terminal, so the stack is already shutting down.
            return stack.wait()


def main() -> int:
    """Start the drive, run the stack, stop the drive."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 20.0
    # A separate session, so that Ctrl-C stops the stack first and the drive last.
    command = bound(sys.executable, HERE / "device.py")
    with subprocess.Popen(command, start_new_session=True) as drive:
        try:
            code = launch(seconds)
        finally:
            drive.terminate()
    return code or drive.returncode


if __name__ == "__main__":
    sys.exit(main())
