"""`obk param save CONFIG`: write the parameters of running nodes into their config."""

import sys

from obk_cli.cli.config_options import make_options, print_findings, wants_colour
from obk_cli.errors import CommandFailedError
from obk_cli.introspect.config_update import find_update, write_update
from obk_cli.introspect.target import GraphTarget

__all__ = ["save"]


def save(config: str, target: GraphTarget, timeout_s: float, *, is_dry: bool) -> None:
    """Write the values, or with `is_dry` show the difference.

    Raises:
        CommandFailedError: the config has errors, none of its nodes is running, or a value cannot
            be written.
    """
    update = find_update(config, make_options(None, None), target, timeout_s)
    for node in update.missing_nodes:
        print(f"warning: {node} is not running; its values are unchanged", file=sys.stderr)
    if update.findings:
        print_findings(update.findings)
        raise CommandFailedError(f"`{config}` has errors; nothing was written")
    if is_dry:
        print(update.diff(colour=wants_colour("auto")), end="")
    else:
        write_update(update)
        for change in update.changes():
            print(change)
    if not update.parameters:
        print(f"{config}: nothing to write, the nodes already use its values", file=sys.stderr)
    if faults := list(update.faults()):
        raise CommandFailedError("not written: " + "\n".join(faults), help="edit these by hand")
