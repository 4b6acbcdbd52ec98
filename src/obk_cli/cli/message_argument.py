"""A message that a user writes as YAML on the command line, checked against its type."""

from obelisk_spec.yaml_core import YamlTextError, load_yaml_core
from obk_cli.errors import MisuseError
from obk_cli.looking.fill import Data, fill

__all__ = ["parse_message"]

MOST_FAULTS = 20


def parse_message(text: str, msg_type: str) -> Data:
    """The fields that a user gives.

    Args:
        text: YAML; empty: none.
        msg_type: of the message, `pkg/Name` or a full name.

    Raises:
        CommandFailedError: the type is not here.
        MisuseError: it is not YAML, or does not fit the type; every fault is told.
    """
    from obk_cli.adapters.ros_types import fields_of

    try:
        value = load_yaml_core(text)
    except YamlTextError as error:
        raise MisuseError(
            f"the message is not YAML: {error}", help="write it as '{field: value, other: [1, 2]}'"
        ) from error
    filled = fill(value, msg_type, fields_of)
    if filled.faults:
        shown = filled.faults[:MOST_FAULTS]
        more = len(filled.faults) - len(shown)
        lines = [*(f"  {fault}" for fault in shown), *([f"  and {more} more"] if more else ())]
        raise MisuseError(
            "\n".join([f"the message does not fit {msg_type}:", *lines]),
            help=", ".join(f"{name}: {kind}" for name, kind in fields_of(msg_type).items())
            or "it has no fields",
        )
    return filled.data
