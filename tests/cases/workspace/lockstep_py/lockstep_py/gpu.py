try:
    import torch
except ImportError:
    torch = None

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class GpuController(Controller):
    """Runs a network if possible."""

    def __init__(self, node_name: str = "gpu") -> None:
        super().__init__(node_name)
        self.has_network = torch is not None


def main() -> None:
    spin_obelisk(None, GpuController)
