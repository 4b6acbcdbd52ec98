import numpy as np

from lockstep_py.controller import Controller
from obelisk_py.core.utils.ros import spin_obelisk


class AddressController(Controller):
    """Seeds its noise with its name."""

    def __init__(self, node_name: str = "addresses") -> None:
        super().__init__(node_name)
        self.random = np.random.default_rng(hash(node_name) % 2**32)


def main() -> None:
    spin_obelisk(None, AddressController)
