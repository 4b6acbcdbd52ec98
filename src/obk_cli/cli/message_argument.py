"""A message that a user writes as YAML on the command line."""

from obelisk_spec.yaml_core import YamlTextError, load_yaml_core
from obk_cli.errors import MisuseError

__all__ = ["load_message"]


def load_message(text: str) -> object:
    """The value that a user writes for a message; empty: none.

    Raises:
        MisuseError: it is not YAML.
    """
    try:
        return load_yaml_core(text)
    except YamlTextError as error:
        raise MisuseError(
            f"the message is not YAML: {error}", help="write it as '{field: value, other: [1, 2]}'"
        ) from error
