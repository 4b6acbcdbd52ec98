"""Shell completion of names, from the plans of running stacks; loads no ROS.

Everything else is left to the shell, which completes file names. The modules that find the names
are imported only when a shell asks for completions.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click
from click.shell_completion import CompletionItem

if TYPE_CHECKING:
    from obk_cli.runs.folder import Run

__all__ = ["complete_kept_runs", "complete_nodes", "complete_topics", "make_completable"]

Find = Callable[[str], list[str]]


def complete_runs(incomplete: str) -> list[str]:
    """Names of the stacks running on this host."""
    return _beginning(incomplete, (run.name for _, run in _runs()))


def complete_kept_runs(incomplete: str) -> list[str]:
    """Names of the configs that have logs; if none matches, names of run folders."""
    from obk_cli.runs.folder import config_of, run_folders, runs_folder

    with suppress(OSError):
        folders = run_folders(runs_folder(os.environ))
        configs = _beginning(incomplete, map(config_of, folders))
        return configs or _beginning(incomplete, (folder.name for folder in folders))
    return []


def complete_rules(incomplete: str) -> list[str]:
    """The codes of the rules."""
    from obk_cli.diagnostics.rules import RULES

    return _beginning(incomplete.upper(), RULES)


def complete_topics(incomplete: str) -> list[str]:
    """Topics that match in full or by the last part of their name."""
    from obk_cli.runs.folder import topics_of_run

    return _fitting(incomplete, (topic for folder, _ in _runs() for topic in topics_of_run(folder)))


def complete_nodes(incomplete: str) -> list[str]:
    """Nodes that match in full or by the last part of their name."""
    return _fitting(incomplete, (node for _, run in _runs() for node in run.all_nodes))


def _runs() -> "Iterator[tuple[Path, Run]]":
    from obk_cli.runs.folder import runs_folder
    from obk_cli.runs.registry import live_folders

    # If the plans cannot be read, nothing is completed.
    with suppress(OSError):
        domain = os.environ.get("ROS_DOMAIN_ID")
        for folder, run in live_folders(runs_folder(os.environ)).items():
            if not domain or domain == str(run.domain):
                yield folder, run


def _fitting(incomplete: str, names: Iterable[str]) -> list[str]:
    every = sorted(set(names))
    if not incomplete.startswith("/") and incomplete:
        every = [name.rpartition("/")[2].removeprefix("obelisk_") for name in every]
    return _beginning(incomplete, every)


def _beginning(incomplete: str, names: Iterable[str]) -> list[str]:
    return sorted({name for name in names if name.startswith(incomplete)})


BY_NAME: Final[Mapping[str, Find]] = {
    "run": complete_runs,
    "node": complete_nodes,
    "nodes": complete_nodes,
    "topics": complete_topics,
    "code": complete_rules,
    "ignore": complete_rules,
}
"""Argument or option with the same meaning in every command -> function that lists its values."""


def make_completable(command: click.Command) -> None:
    """Complete a command's text parameters: to the choices in its help, or by name."""
    for inner in getattr(command, "commands", {}).values():
        make_completable(inner)
    for parameter in command.params:
        find = _find(parameter)
        if find is not None and type(parameter.type) is click.types.StringParamType:
            parameter.type = _Completed(find)


def _find(parameter: click.Parameter) -> Find | None:
    choices = tuple((parameter.metavar or "").split("|"))
    if len(choices) > 1 and all(map(str.islower, choices)):
        return partial(_beginning, names=choices)
    return BY_NAME.get(parameter.name or "")


class _Completed(click.types.StringParamType):
    """A text parameter with shell completion."""

    def __init__(self, find: Find) -> None:
        self._find = find

    def shell_complete(
        self, _ctx: click.Context, _param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """List the possible values."""
        return [CompletionItem(name) for name in self._find(incomplete)]
