"""Run `OnnxPolicy` as a process."""

from obelisk_py.core.utils.ros import spin_obelisk
from obelisk_py.zoo.control.policy import OnnxPolicy

if __name__ == "__main__":
    spin_obelisk(None, OnnxPolicy)
