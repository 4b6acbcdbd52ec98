"""Which log file is meant by a run's and a node's name."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from obelisk_spec.suggestions import did_you_mean, list_names
from obk_cli.asking.names import nodes_meant
from obk_cli.errors import CommandFailedError
from obk_cli.launch.runs import config_of, read_run, run_folders

__all__ = ["LAUNCH_LOG", "log_meant"]

LAUNCH_LOG: Final = "launch.log"


def log_meant(parent: Path, run: str | None, node: str | None) -> Path:
    """The path of a log, which may not be there yet.

    Args:
        parent: the folder of all runs.
        run: a config's name or a run folder's; None: the newest run. What is no run is taken for a
            node of the newest one where no node is given.
        node: full or in short; None: what the launcher showed.

    Raises:
        CommandFailedError: there is no such run or node, or the name means several nodes.
    """
    folders = run_folders(parent)
    if not folders:
        raise CommandFailedError(
            f"there are no runs in {parent}", help="start a stack with `obk launch`"
        )
    named = None if run is None else _folder(folders, run)
    if run is not None and named is None:
        if node is None and nodes_meant(run, _nodes(folders[0])):
            return _node_log(folders[0], run)
        names = dict.fromkeys(config_of(folder) for folder in folders)
        of_newest = () if node else tuple(map(_short, _nodes(folders[0])))
        what = "run" if node else "run, nor a node of the newest one,"
        raise CommandFailedError(
            f"there is no {what} called `{run}`", help=did_you_mean(run, (*names, *of_newest))
        )
    folder = named or folders[0]
    return folder / LAUNCH_LOG if node is None else _node_log(folder, node)


def _folder(folders: Sequence[Path], name: str) -> Path | None:
    """The newest of a config, or the very one."""
    config = name.replace("/", "_")
    fitting = (folder for folder in folders if name == folder.name or config == config_of(folder))
    return next(fitting, None)


def _nodes(folder: Path) -> tuple[str, ...]:
    """Full names of the nodes that have a log, or will have one."""
    run = read_run(folder)
    logs = (path.stem for path in sorted(folder.glob("*.log")) if path.name != LAUNCH_LOG)
    written = (f"/{stem.replace('.', '/')}" for stem in logs)
    return tuple(dict.fromkeys((*(run.all_nodes if run else ()), *written)))


def _node_log(folder: Path, name: str) -> Path:
    known = _nodes(folder)
    meant = nodes_meant(name, known)
    if not meant:
        raise CommandFailedError(
            f"the run {folder.name} has no node `{name}`",
            help=did_you_mean(name, map(_short, known)),
        )
    if len(meant) > 1:
        raise CommandFailedError(
            f"`{name}` means several nodes", help=f"name one of {list_names(map(_short, meant))}"
        )
    return folder / f"{meant[0].strip('/').replace('/', '.')}.log"


def _short(node: str) -> str:
    return node.strip("/").removeprefix("obelisk_")
