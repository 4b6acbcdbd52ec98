"""Imports that may fail, or that static analysis cannot follow."""

from contextlib import suppress
from typing import TYPE_CHECKING

from demo_py.controller import ArmController
from obelisk_py.core.utils.ros import spin_obelisk

if TYPE_CHECKING:
    from demo_py.annotations_only import Gains

try:
    import policy_runtime_of_nowhere as policy_runtime
except ImportError:
    policy_runtime = None

with suppress(ImportError):
    import telemetry_of_nowhere  # noqa: F401


class OptionalController(ArmController):
    gains: "Gains | None" = None

    def load(self) -> None:
        """Imported only if the parameter requests it."""
        import planner_of_nowhere

        self.planner = planner_of_nowhere.Planner(policy_runtime)


def main() -> None:
    spin_obelisk(None, OptionalController)
