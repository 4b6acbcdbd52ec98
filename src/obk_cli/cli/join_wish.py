"""The options of `obk new` that say into which config, and where, the new node goes.

In: the options as typed. Out: the wish. Reads no file.
"""

from dataclasses import dataclass

from obk_cli.errors import MisuseError
from obk_cli.files import STANDARD_INPUT

__all__ = ["JoinWish", "join_wish"]


@dataclass(frozen=True, slots=True, kw_only=True)
class JoinWish:
    """The options about the config."""

    config: str
    device: str | None = None
    replaces: str | None = None


def join_wish(config: str | None, device: str | None, replaces: str | None) -> JoinWish | None:
    """What the options come to, None where no config is to change.

    Raises:
        MisuseError: they do not go together, or the config is the standard input.
    """
    if config == STANDARD_INPUT:
        raise MisuseError("`--add-to -`: a file is changed, so it needs one")
    if config is not None:
        return JoinWish(config=config, device=device, replaces=replaces)
    for option, value in (("--device", device), ("--replace", replaces)):
        if value is not None:
            raise MisuseError(f"`{option}` says where in a config: give `--add-to CONFIG` too")
    return None
