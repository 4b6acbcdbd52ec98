"""Word click's command-line errors as `obk` words its own."""

import re
from collections.abc import Iterable
from typing import Final

import click

from obelisk_spec.suggestions import ask_for, did_you_mean, near_names
from obk_cli.errors import MisuseError

__all__ = ["misuse"]

_QUOTED: Final = re.compile(r"'([^'\s]+)'")


def misuse(error: click.UsageError, context: click.Context) -> MisuseError:
    """The error for the user: what is wrong in one line, and what would be right.

    Args:
        error: raised by click.
        context: of `obk`; an error mostly has that of the command.
    """
    context = error.ctx or context
    command, path = context.command, context.command_path
    usage = f"usage: `{' '.join([path, *command.collect_usage_pieces(context)])}`"
    match error:
        case click.NoSuchOption():
            option = error.option_name
            known = _options(command.get_params(context)) if option.startswith("--") else ()
            near = ask_for(near_names(option, known))
            return MisuseError(f"`{path}` has no option `{option}`", help=near or usage)
        case click.MissingParameter(param=click.Parameter() as param):
            return MisuseError(f"`{path}` needs {param.make_metavar(context)}", help=usage)
        case click.BadParameter(param=click.Parameter() as param):
            is_option = isinstance(param, click.Option)
            shown = max(param.opts, key=len) if is_option else param.make_metavar(context)
            return MisuseError(f"`{shown}`: {_sentence(error.message)}")
        case _ if isinstance(command, click.Group) and (unknown := _unknown_command(error)):
            return MisuseError(
                f"unknown command `{path} {unknown}`",
                help=did_you_mean(unknown, command.list_commands(context)),
            )
        case _:
            return MisuseError(_sentence(error.message), help=usage if error.ctx else None)


def _options(params: Iterable[click.Parameter]) -> list[str]:
    return [name for param in params for name in param.opts if name.startswith("--")]


def _unknown_command(error: click.UsageError) -> str | None:
    found = re.fullmatch(r"No such command '(.+)'\.", error.message)
    return found and found[1]


def _sentence(message: str) -> str:
    """A message without capital and full stop, and with names as `obk` quotes them."""
    plain = _QUOTED.sub(r"`\1`", message.removesuffix("."))
    return plain[:1].lower() + plain[1:]
