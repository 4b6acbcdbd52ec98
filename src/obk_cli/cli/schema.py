"""`obk schema`: the JSON schema of configs, for editors and other checkers."""

from obk_cli.resources import resource_folder

__all__ = ["EXAMPLE", "command"]

EXAMPLE = "Example: obk schema > obelisk.schema.json"


def command() -> None:
    """Print the JSON schema (draft 2020-12) of configs."""
    path = resource_folder("schema") / "obelisk.schema.json"
    print(path.read_text(encoding="utf-8"), end="")
