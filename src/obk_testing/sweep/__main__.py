"""Run a sweep: `python -m obk_testing.sweep REQUEST`, started by `obk sweep`.

REQUEST is a `SweepRequest` as JSON. Exit codes: 0 if all cases passed; 1 if a case failed or the
config has errors; 2 if the request is invalid; 130 if interrupted.
"""

import ast
import json
import os
import shutil
import signal
import sys
import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NoReturn

from obelisk_spec.suggestions import with_number
from obk_cli.emit.json import json_text
from obk_cli.errors import (
    EXIT_DONE,
    EXIT_FAILED,
    EXIT_INTERRUPTED,
    CommandFailedError,
    MisuseError,
    ObkError,
)
from obk_cli.optional_deps import require_extra
from obk_cli.process.signals import accept_interrupt, insist_on_interrupt, release_interrupts
from obk_cli.terminal import visible
from obk_testing.programs import CompiledStack, compile_stack
from obk_testing.summary import unused_notes
from obk_testing.sweep.cases import (
    FoundTest,
    SweepCase,
    Varied,
    files_of_config,
    make_cases,
    parse_varied,
    with_types_of_config,
)
from obk_testing.sweep.engines import Engine, LocalEngine, RestartingWorker, WorkerProcess
from obk_testing.sweep.report import report_page
from obk_testing.sweep.store import SweepStore, hashes_of, installed_sources
from obk_testing.sweep.summary import Result, Summary, duration_text, summary_json, summary_text
from obk_testing.sweep.worker import machine

__all__ = ["SweepRequest", "run_sweep"]

_LINE_S: Final = 10.0
"""Time between two progress lines if they cannot be overwritten [s]."""
_CODE: Final = frozenset({".py"})
_CONFIGS: Final = (".yaml", ".yml")
_MODELS: Final = frozenset({".xml", ".mjcf", ".urdf", ".obj", ".stl", ".msh", ".png"})
_OF_ANY_RUN: Final = ("cores", "system")
"""Properties of the machine that do not affect the bits of a run."""
_BUILT: Final = frozenset({"__pycache__", "build", ".git", ".venv"})


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepRequest:
    """The arguments of a sweep."""

    config: str
    tests: Sequence[str] = ()
    """Tests as for pytest, absolute paths; empty for the smoke test."""
    seeds: int = 1
    vary: Sequence[str] = ()
    is_grid: bool = False
    workers: int = 1
    engine: str = "local"
    scheduler: str | None = None
    output: str | None = None
    is_restart: bool = False
    case_limit_s: float = 600.0
    """Maximum wall time of a case [s]."""
    overrides: Sequence[str] = ()
    is_json: bool = False


class _Progress:
    """Shows counts, failures, rate and remaining time on stderr."""

    def __init__(self, count: int, done: int, bad: int) -> None:
        self._count, self._done, self._bad = count, done, bad
        self._before = done
        self._start = time.monotonic()
        self._printed = self._start
        self._on_terminal = sys.stderr.isatty()

    def add(self, *, is_bad: bool) -> None:
        """Count a finished case."""
        self._done += 1
        self._bad += is_bad
        now = time.monotonic()
        if now - self._printed >= (0.1 if self._on_terminal else _LINE_S):
            self._printed = now
            self._print(self._text(now - self._start))

    def note(self, text: str) -> None:
        """Print a permanent line."""
        print(f"{self._clear()}{visible(text)}", file=sys.stderr, flush=True)

    def end(self) -> None:
        """Remove the progress line."""
        print(self._clear(), end="", file=sys.stderr, flush=True)

    def _text(self, seconds: float) -> str:
        rate = (self._done - self._before) / max(seconds, 1e-3)
        left = (self._count - self._done) / rate
        return (
            f"{self._done} of {self._count}, {self._bad} failed, {rate:.1f} a second, "
            f"{duration_text(left)} left"
        )

    def _print(self, text: str) -> None:
        text = text[: shutil.get_terminal_size().columns - 1]  # one line can be overwritten
        end = "" if self._on_terminal else "\n"
        print(f"{self._clear()}{text}", end=end, file=sys.stderr, flush=True)

    def _clear(self) -> str:
        return "\r\x1b[K" if self._on_terminal else ""


def run_sweep(request: SweepRequest) -> int:
    """Run the cases without a result, report all cases, and return the exit code.

    Raises:
        ObkError: the sweep cannot run.
    """
    config = Path(request.config).resolve()
    if request.engine == "dask":
        require_extra("distributed", "sweep")
    varied = tuple(map(parse_varied, request.vary))
    varied = with_types_of_config(varied, config, dict(os.environ))
    compiled = _checked(config, varied, request.overrides)
    folder = Path(request.output or Path("build", "obk-sweep", compiled.plan.name))
    with (
        SweepStore(folder.absolute(), restart=request.is_restart) as store,
        _terminated_as_interrupted(),
    ):
        first = WorkerProcess(config, tuple(request.tests), store.scratch)
        try:
            tests = _require_tests(first, request)
            hashes = hashes_of(_inputs(compiled, first.hello.files), Path.cwd())
            versions = {name: text for name, text in machine().items() if name not in _OF_ANY_RUN}
            inputs = {**hashes, **installed_sources(), **versions}
            if not request.is_restart:
                read = hashes_of(map(Path, store.inputs()), Path.cwd())
                store.require_same_inputs({**read, **inputs})
            cases = make_cases(
                tests,
                seeds=request.seeds,
                varied=varied,
                is_grid=request.is_grid,
                overrides=request.overrides,
            )
            is_complete = _run(request, config, cases, store, first, inputs)
        finally:
            first.close()
        rows = store.rows()
        summary = Summary(
            name=compiled.plan.name,
            config=request.config,
            results=tuple(Result(case=c, row=rows[c.key]) for c in cases if c.key in rows),
            count=len(cases),
            varied=tuple(each.path for each in varied),
            notes=store.notes(),
            machine=machine(),
            engine=request.engine,
        )
        page = folder / "report.html"
        page.write_text(report_page(summary), encoding="utf-8")
    if request.is_json:
        values = summary_json(summary, str(page), str(folder / "sweep.sqlite"))
        print(json_text(values), end="")
    else:
        print(summary_text(summary, str(page)))
    if not is_complete:
        print("interrupted; run the same command again to continue", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_DONE if summary.all_passed else EXIT_FAILED


def _checked(config: Path, varied: Sequence[Varied], overrides: Sequence[str]) -> CompiledStack:
    """Compile the config unchanged, and with the ends of every range."""
    compiled = compile_stack(config, overrides)
    for each in varied:
        for value in each.ends():
            changes = (*overrides, f"{each.path}={value}")
            try:
                compile_stack(config, changes, environment=compiled.environment)
            except CommandFailedError as error:
                raise MisuseError(
                    f"`--vary {each.path}`: with the value {value}, {error.message}",
                    help="vary it over values that the config allows",
                ) from error
    return compiled


def _require_tests(worker: WorkerProcess, request: SweepRequest) -> tuple[FoundTest, ...]:
    hello = worker.hello
    if hello.problem:
        raise CommandFailedError(f"the tests cannot be collected\n{hello.problem}")
    if not hello.tests:
        raise MisuseError(
            f"no test of {', '.join(request.tests)} uses the `stack` fixture",
            help="write one: `def test_it_stands(stack, seed): ...`",
        )
    if hello.left_out:
        count = with_number(hello.left_out, "test")
        print(f"skipping {count} without the `stack` fixture", file=sys.stderr)
    return hello.tests


def _inputs(compiled: CompiledStack, modules: Sequence[str]) -> Iterator[Path]:
    """Yield the files that results depend on, as far as they can be found without running."""
    yield from _inputs_of_config(compiled)
    configs: dict[Path, None] = {}
    for path in map(Path, modules):
        yield path
        yield from (folder / "conftest.py" for folder in path.parents)
        configs |= {config.resolve(): None for config in _named_configs(path)}
    configs.pop(Path(compiled.config).resolve(), None)
    for config in configs:
        yield config
        with suppress(ObkError):  # another YAML file, or a config that no test starts
            yield from _inputs_of_config(compile_stack(config))


def _inputs_of_config(compiled: CompiledStack) -> Iterator[Path]:
    yield from files_of_config(compiled.config, dict(os.environ))
    for node in compiled.plan.nodes:
        for value in node.parameters.values():
            if isinstance(value, str) and value.startswith("/"):  # such as `params_path`
                yield Path(value)
        if (source := compiled.packages.source_packages.get(node.package)) is not None:
            yield from _files(source, _CODE)
        if node.model:
            yield from _files(Path(node.model).parent, _MODELS)


def _named_configs(module: Path) -> Iterator[Path]:
    """Yield the files that a module names like `stack("../arm.yaml")`, relative to its folder."""
    with suppress(OSError, SyntaxError, ValueError):
        for node in ast.walk(ast.parse(module.read_bytes())):
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and text.endswith(_CONFIGS):
                path = (module.parent / text).resolve()
                if path.is_file():
                    yield path


def _files(folder: Path, kinds: Collection[str]) -> Iterator[Path]:
    for path in sorted(folder.rglob("*")):
        is_built = not _BUILT.isdisjoint(path.relative_to(folder).parts)
        if path.suffix.lower() in kinds and not is_built:
            yield path


def _run(
    request: SweepRequest,
    config: Path,
    cases: Sequence[SweepCase],
    store: SweepStore,
    first: WorkerProcess,
    inputs: Mapping[str, str],
) -> bool:
    """Run the cases without a result, and return whether all of them have finished."""
    rows = {} if request.is_restart else store.rows()
    pending = [case for case in cases if case.key not in rows]
    bad = sum(rows[case.key].is_bad for case in cases if case.key in rows)
    done = len(cases) - len(pending)
    if done:
        print(f"continuing: {done} of {with_number(len(cases), 'case')} done", file=sys.stderr)
    if not pending:
        return True
    by_key = {case.key: case for case in pending}
    progress = _Progress(len(cases), done, bad)
    try:
        with _engine(request, config, store.scratch, first, cases[0]) as engine:
            if request.is_restart:  # only after everything that can fail was checked
                store.clear()
                store.require_same_inputs(inputs)
            seen = set(store.notes())
            unused: dict[str, list[Sequence[str]]] = {}
            for placed in engine.map(pending):
                store.add_inputs(hashes_of(map(Path, placed.row.files), Path.cwd()))
                store.add(by_key[placed.row.key], placed.row)
                progress.add(is_bad=placed.row.is_bad)
                unused.setdefault(by_key[placed.row.key].test, []).append(placed.row.unused)
                if placed.note and placed.note not in seen:
                    seen.add(placed.note)
                    store.add_note(placed.note)
                    progress.note(f"note: {placed.note}")
            for test, cases_unused in unused.items():
                for note in unused_notes(test, cases_unused):
                    store.add_note(note)
    except KeyboardInterrupt:
        accept_interrupt()
        return False
    finally:
        progress.end()
    return True


@contextmanager
def _engine(
    request: SweepRequest, config: Path, scratch: Path, first: WorkerProcess, probe: SweepCase
) -> Iterator[Engine]:
    tests, limit_s = tuple(request.tests), request.case_limit_s
    if request.engine == "local":
        with LocalEngine(
            config, tests, scratch, workers=request.workers, limit_s=limit_s, first=first
        ) as local:
            yield local
        return
    from obk_testing.sweep.dask_engine import DaskEngine

    worker = RestartingWorker(config, tests, scratch, limit_s=limit_s, first=first)
    digest = worker.run(probe).digest
    worker.close()
    with DaskEngine(
        config,
        tests,
        scratch,
        scheduler=request.scheduler,
        workers=request.workers,
        limit_s=limit_s,
        probe=probe,
        digest=digest,
    ) as engine:
        yield engine


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """Make SIGTERM stop the sweep like Ctrl-C inside the `with` block."""

    def interrupt(*_: Any) -> NoReturn:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def main() -> None:
    """Run the sweep in the command-line argument."""
    try:
        with insist_on_interrupt():
            release_interrupts()  # held by `obk sweep`
            sys.exit(run_sweep(SweepRequest(**json.loads(sys.argv[1]))))
    except ObkError as error:
        text = f"error: {error.message}" + (f"\n  help: {error.help}" if error.help else "")
        print("\n".join(map(visible, text.split("\n"))), file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(EXIT_INTERRUPTED)


if __name__ == "__main__":
    main()
