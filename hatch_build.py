"""Build hook of obelisk-cli: adds a copy of `schema/` and `templates/` to the wheel.

An editable install has no copy and reads the folders of the checkout.
"""

from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

__all__ = ["DataHook"]


class DataHook(BuildHookInterface[Any]):
    """Adds the data folders to a real wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """List the data folders in `build_data`."""
        if version == "standard":
            folders = (Path(self.root) / name for name in ("schema", "templates"))
            build_data["force_include"].update({str(f): f"obk_cli/data/{f.name}" for f in folders})
