"""Libraries that only some commands need: whether they are here, before anything is imported."""

import importlib.util

from obk_cli.errors import CommandFailedError

__all__ = ["require_extra"]


def require_extra(module: str, extra: str) -> None:
    """Make sure that a library is here.

    Args:
        module: that the library is imported by.
        extra: of the distribution `obelisk-cli`, that brings it.

    Raises:
        CommandFailedError: it is not.
    """
    if importlib.util.find_spec(module) is None:
        raise CommandFailedError(
            f"the library `{module}` is not installed",
            help=f"install obk with its `{extra}` extra: obelisk-cli[{extra}]",
        )
