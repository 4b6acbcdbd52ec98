import threading
import time

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class ThreadController(Controller):
    """Counts in a thread next to its callbacks."""

    def __init__(self, node_name: str = "threads") -> None:
        super().__init__(node_name)
        self.count = 0
        threading.Thread(target=self.go_on, daemon=True).start()

    def go_on(self) -> None:
        while True:
            self.count += 1
            time.sleep(0.01)


def main() -> None:
    spin_obelisk(None, ThreadController)
