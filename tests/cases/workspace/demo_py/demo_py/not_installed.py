import policy_runtime_of_nowhere

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk


class PolicyController(ArmController):
    policy = policy_runtime_of_nowhere.load("walk")


def main() -> None:
    spin_obelisk(None, PolicyController)
