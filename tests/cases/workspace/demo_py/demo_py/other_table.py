from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class PausedController(ArmController):
    def pause(self) -> None:
        self.obk_publishers["timer_ctrl"].cancel()


def main() -> None:
    spin_obelisk(None, PausedController)
