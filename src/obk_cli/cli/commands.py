"""The `obk` command: its table of subcommands, and how errors become messages and exit codes.

A command's module is imported only when that command runs, so that `obk --help` is quick.
"""

import errno
import importlib
import os
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from io import TextIOWrapper
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NoReturn

import click
import typer
from click.shell_completion import CompletionItem
from typer.core import TyperCommand, TyperGroup

from obelisk_recordings.bag import RecordingError
from obelisk_spec.suggestions import ask_for, did_you_mean
from obk_cli.errors import EXIT_CLOSED_PIPE, EXIT_FAILED, MisuseError, ObkError
from obk_cli.process.signals import is_interrupted

__all__ = ["GROUPS", "VERBS", "root_command", "run"]

# Help is plain here; with rich, typer imports a renderer only to escape a bracket for it.
typer.core.HAS_RICH = False


@dataclass(frozen=True, slots=True)
class Verb:
    """One command: the module that holds it, and its line in `obk --help`."""

    module: str
    help: str


GROUPS: Final[Mapping[str, Mapping[str, Verb]]] = MappingProxyType(
    {
        "Start": {
            "init": Verb("obk_cli.cli.init", "Create a workspace that is ready to launch."),
            "new": Verb("obk_cli.cli.new", "Create a package, a node or a config from templates."),
            "build": Verb("obk_cli.cli.build", "Compile the workspace's message packages."),
        },
        "Check": {
            "validate": Verb("obk_cli.cli.validate", "Check configs without running anything."),
            "explain": Verb(
                "obk_cli.cli.explain", "Explain a rule and how to fix what it reports."
            ),
            "graph": Verb("obk_cli.cli.graph", "Draw a stack in the terminal or as an image."),
            "test": Verb("obk_cli.cli.test", "Run closed-loop tests in simulated time."),
            "sweep": Verb(
                "obk_cli.cli.sweep", "Run closed-loop tests across many seeds and parameter values."
            ),
            "rehearse": Verb(
                "obk_cli.cli.rehearse", "Test how a stack reacts when its nodes fail."
            ),
            "doctor": Verb(
                "obk_cli.cli.doctor", "Check this machine and explain how to fix problems."
            ),
        },
        "Run": {
            "launch": Verb("obk_cli.cli.launch", "Start, bring up and supervise a stack."),
            "lifecycle": Verb(
                "obk_cli.cli.lifecycle", "Show or change the lifecycle states of nodes."
            ),
            "ps": Verb("obk_cli.cli.ps", "List the stacks running on this host."),
            "stop": Verb("obk_cli.cli.stop", "Shut a stack down cleanly."),
            "reap": Verb(
                "obk_cli.cli.reap",
                "Terminate processes left over from stacks whose launcher has exited.",
            ),
        },
        "Inspect": {
            "monitor": Verb(
                "obk_cli.cli.monitor", "Show the nodes, rates and log of a running stack."
            ),
            "web": Verb("obk_cli.cli.web", "Show a running stack in the browser."),
            "logs": Verb("obk_cli.cli.logs", "Show the logs of a run or of one of its nodes."),
            "topic": Verb("obk_cli.cli.topic", "Inspect and measure topics, and publish to them."),
            "node": Verb("obk_cli.cli.node", "Inspect the nodes of a running stack."),
            "param": Verb("obk_cli.cli.param", "Show and set parameters of running nodes."),
            "service": Verb("obk_cli.cli.service", "List and call services of a running stack."),
        },
        "Record": {
            "record": Verb(
                "obk_cli.cli.record", "Record topics of a running stack to an MCAP file."
            ),
            "bag": Verb("obk_cli.cli.bag", "Show what a recording contains."),
            "plot": Verb("obk_cli.cli.plot", "Plot fields of a recording."),
            "diff": Verb("obk_cli.cli.diff", "Compare two recorded runs."),
            "export": Verb("obk_cli.cli.export", "Convert a recording to Parquet or CSV."),
            "play": Verb("obk_cli.cli.play", "Replay a recording, or run nodes on it."),
        },
        "Convert": {
            "compile": Verb(
                "obk_cli.cli.compile", "Convert a config to parameters, a launch file or JSON."
            ),
            "migrate": Verb(
                "obk_cli.cli.migrate", "Convert a config to the newer syntax, or back."
            ),
            "schema": Verb("obk_cli.cli.schema", "Print the JSON schema of configs."),
        },
    }
)
"""The commands as `obk --help` groups them."""

VERBS: Final[Mapping[str, Verb]] = MappingProxyType(
    {name: verb for group in GROUPS.values() for name, verb in group.items()}
)
"""Command -> its module, which has `app` (a Typer) or `command` (a function)."""


_OTHER_WORDS: Final = MappingProxyType(
    {
        "check": "validate",
        "create": "new",
        "down": "stop",
        "draw": "graph",
        "kill": "stop",
        "lint": "validate",
        "replay": "play",
        "run": "launch",
        "start": "launch",
        "status": "ps",
        "up": "launch",
    }
)
"""Name of a command in other tools -> its name here."""

_COMPLETION = frozenset({"--install-completion", "--show-completion"})
"""Options that typer adds."""


@contextmanager
def _ending_with_reader() -> Iterator[None]:
    """Exit if the output's reader has; click would exit with 1, as if the config had errors."""
    try:
        yield
    except BrokenPipeError:
        sys.exit(EXIT_CLOSED_PIPE)


class _LazyGroup(TyperGroup):
    """The commands of the table, each imported on first use."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        with _own_words(ctx), _ending_with_reader():
            return super().parse_args(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        with _own_words(ctx), _ending_with_reader():
            return super().invoke(ctx)

    def list_commands(self, _: Any) -> list[str]:
        return list(VERBS)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        if cmd_name in VERBS:
            command = _load(cmd_name, VERBS[cmd_name])
            if ctx.resilient_parsing:  # the shell requests completions
                from obk_cli.cli.complete import make_completable

                make_completable(command)
            return command
        if ctx.resilient_parsing:
            return None
        raise MisuseError(f"unknown command `{cmd_name}`", help=_suggestion(cmd_name))

    def shell_complete(self, ctx: click.Context, incomplete: str) -> list[CompletionItem]:
        verbs = (name for name in VERBS if name.startswith(incomplete))
        items = [CompletionItem(name, help=VERBS[name].help) for name in verbs]
        return [*items, *click.Command.shell_complete(self, ctx, incomplete)]

    def format_commands(self, _: Any, formatter: Any) -> None:
        widest = max(map(len, VERBS))
        for title, group in GROUPS.items():
            with formatter.section(title):
                formatter.write_dl(
                    [(name.ljust(widest), verb.help) for name, verb in group.items()]
                )


_SHOWS_HELP: Final[Any] = getattr(click.exceptions, "NoArgsIsHelpError", ())
"""What click raises to show the help of a group; click 8.1 shows it at once."""


@contextmanager
def _own_words(context: click.Context) -> Iterator[None]:
    """Convert click's errors to `MisuseError`, except the one that shows a group's help."""
    try:
        yield
    except _SHOWS_HELP:
        raise
    except click.UsageError as error:
        from obk_cli.cli.usage_errors import misuse

        raise misuse(error, context) from error


class _GroupedCommand(TyperCommand):
    """A command with many options, which its help shows in groups."""

    option_groups: Mapping[str, Collection[str]] = MappingProxyType({})
    """Title -> its options; every option is listed, `--help` included."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        # Click returns the names of `--help` in no fixed order.
        params = {max(param.opts, key=len): param for param in self.get_params(ctx)}
        arguments = [name for name, param in params.items() if param.param_type_name == "argument"]
        widest = max(len(_help_of(params[name], ctx)[0]) for name in params)
        for title, names in {"Arguments": arguments, **self.option_groups}.items():
            with formatter.section(title):
                records = (_help_of(params[name], ctx) for name in names)
                formatter.write_dl([(name.ljust(widest), text) for name, text in records])


def _help_of(param: click.Parameter, context: click.Context) -> tuple[str, str]:
    """A parameter's usage text and its help."""
    return param.get_help_record(context) or ("", "")


def _load(name: str, verb: Verb) -> Any:
    module = importlib.import_module(verb.module)
    app = getattr(module, "app", None)
    if app is not None:
        command = typer.main.get_command(app)
    else:
        groups = getattr(module, "OPTION_GROUPS", {})
        app = typer.Typer(add_completion=False, rich_markup_mode=None)
        app.command(
            name,
            cls=_GroupedCommand if groups else TyperCommand,
            epilog=getattr(module, "EXAMPLE", None),
        )(module.command)
        command = typer.main.get_command(app)
        if isinstance(command, _GroupedCommand):
            command.option_groups = groups
    command.name = name
    return command


def _suggestion(name: str) -> str | None:
    """The command that was probably meant: a synonym, a subcommand, or a similar name."""
    if name in _OTHER_WORDS:
        return ask_for((f"obk {_OTHER_WORDS[name]}",))
    places = (f"obk {verb} {name}" for verb in VERBS if name in _subcommands(verb))
    return ask_for(places) or did_you_mean(name, VERBS)


def _subcommands(verb: str) -> Collection[str]:
    """The names of a command's subcommands."""
    module = importlib.import_module(VERBS[verb].module)
    names: Collection[str] = getattr(module, "SUBCOMMANDS", ())
    return names if names else getattr(_load(verb, VERBS[verb]), "commands", ())


def _show_version(is_requested: bool) -> None:
    if is_requested:
        from importlib.metadata import version

        print(f"obk {version('obelisk-cli')}")
        raise typer.Exit


_EPILOG: Final = """\b
`obk help COMMAND` describes a command.
Example: obk validate config.yaml
"""


def _root(
    version: bool = typer.Option(
        False, "--version", help="Print the version.", callback=_show_version, is_eager=True
    ),
    debug: bool = typer.Option(False, "--debug", help="Show the traceback of an error."),
) -> None:
    """Check, build, launch and inspect Obelisk robot control stacks."""


def root_command() -> Any:
    """`obk` as a click command, to run or to document."""
    app = typer.Typer(
        cls=_LazyGroup,
        name="obk",
        rich_markup_mode=None,
        pretty_exceptions_enable=False,
        context_settings={"help_option_names": ["--help", "-h"]},
    )
    app.callback(epilog=_EPILOG)(_root)
    return typer.main.get_command(app)


def run(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run `obk` and exit with its exit code."""
    _reopen_closed_streams()
    _escape_unencodable()
    given = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in given
    try:
        try:
            root_command().main(args=_as_options(given), prog_name="obk")
        except SystemExit:
            if not _flush_output():
                sys.exit(EXIT_CLOSED_PIPE)
            raise
        finally:
            _flush_output()
    except (ObkError, RecordingError) as error:
        if is_interrupted():
            raise
        if debug:
            import traceback

            traceback.print_exc()
        _print_error(error.message, error.help)
        sys.exit(error.exit_code)
    except Exception as error:  # a bug in obk
        if debug or is_interrupted():
            raise
        _print_error(*_describe_error(error, given))
        sys.exit(EXIT_FAILED)
    sys.exit(0)


def _as_options(given: Sequence[str]) -> list[str]:
    """The arguments without `--debug`; `help COMMAND` and `version` become options."""
    words = [word for word in given if word != "--debug"]
    match words:
        case ["help", *command]:
            return [*command, "--help"]
        case ["version"]:
            return ["--version"]
    return words


def _reopen_closed_streams() -> None:
    """Open the null device for standard streams that were closed by the parent."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            stream = Path(os.devnull).open(mode, encoding="utf-8")  # noqa: SIM115 - for good
            os.set_inheritable(stream.fileno(), True)
            setattr(sys, name, stream)


def _escape_unencodable() -> None:
    """Escape characters that the outputs cannot encode, such as bytes in a file name."""
    for output in (sys.stdout, sys.stderr):
        if isinstance(output, TextIOWrapper):
            output.reconfigure(errors="backslashreplace")


def _flush_output() -> bool:
    """Flush the output while an error can still be reported; return whether its reader exists.

    This leaves nothing for the flush at exit, which would fail again.

    Raises:
        OSError: the output cannot be written; the rest of it is discarded.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115 - for good
        if error.errno != errno.EPIPE:
            raise
        return False
    return True


def _print_error(message: str, help: str | None) -> None:
    from obk_cli.terminal import visible

    text = f"error: {message}\n  help: {help}" if help else f"error: {message}"
    print("\n".join(map(visible, text.split("\n"))), file=sys.stderr)


def _describe_error(error: Exception, given: Collection[str]) -> tuple[str, str | None]:
    """The cause of an unexpected error, and the fix if one is known."""
    from obk_cli.errors import pythonpath_shadow, resource_error

    if (shadow := pythonpath_shadow(error)) is not None:
        return f"{type(error).__name__}: {error}: {shadow}", "unset PYTHONPATH"
    if (cause := resource_error(error)) is not None:
        return cause, None
    if isinstance(error, OSError) and not _COMPLETION.isdisjoint(given):
        return _no_completion(error), "run it in bash, zsh or fish with a writable home directory"
    return _bug_report(error), None


def _no_completion(error: OSError) -> str:
    """Why shell completion was not set up.

    An error without a file name means that no supported shell was found.
    """
    from obk_cli.files import unwritable

    if not isinstance(error.filename, str):
        return "obk was not started from a supported shell"
    return unwritable(Path(error.filename), error).message


def _bug_report(error: Exception) -> str:
    """Write the traceback to a file and return a message with its path."""
    import tempfile
    import traceback

    summary = f"this is a bug in obk ({type(error).__name__}: {error})"
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="obk-", suffix=".trace", delete=False, encoding="utf-8"
        ) as file:
            traceback.print_exception(error, file=file)
    except OSError:
        return f"{summary}; run `obk --debug` to see the traceback"
    return f"{summary}; the traceback is in {Path(file.name)}"
