from typing import Any

from obelisk_py.core.control import ObeliskController
from obelisk_py.core.utils.ros import spin_obelisk


class Unfinished(ObeliskController):
    def update_xhat(self, x_hat_msg: Any) -> None:
        self.x_hat = x_hat_msg

    def compute_control(self) -> None:
        self.obk_publishers["pub_ctrl"].publish(self.x_hat)


def main() -> None:
    spin_obelisk(None, Unfinished)
