from obelisk_control_msgs.msg import PositionSetpoint

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk

CONTROL = "pub_ctrl"


class KeysController(ArmController):
    """Accesses its components in every way that is correct, or that only a run can judge."""

    def compute_control(self) -> PositionSetpoint:
        msg = PositionSetpoint(u_mujoco=[0.0])
        self.obk_publishers[CONTROL].publish(msg)
        self.obk_publishers["publisher_ctrl"].publish(msg)
        self.obk_publishers["pub_ctrl_setting"].publish(msg)
        self.obk_timers["timer_ctrl"].reset()
        for name in ("ctrl",):
            self.obk_publishers[f"pub_{name}"].publish(msg)
        try:
            self.obk_publishers["pub_debug"].publish(msg)
        except KeyError:
            self.get_logger().debug("no debugging")
        return msg

    def report(self, msg: PositionSetpoint) -> None:
        if "pub_report" in self.obk_publishers:
            self.obk_publishers["pub_report"].publish(msg)


def main() -> None:
    spin_obelisk(None, KeysController)
