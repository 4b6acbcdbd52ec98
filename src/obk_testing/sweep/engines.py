"""Run the cases of a sweep in processes on this machine.

Every engine runs cases in `WorkerProcess`es: separate interpreters with a fixed hash seed and one
thread for linear algebra. So no result depends on the engine, the order or the number of workers.
`ProcessPoolExecutor` is not suitable: it terminates all workers if one dies. It also cannot be used
in a Dask worker, because a daemon process may not start child processes with it.
"""

import json
import os
import queue
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final, Protocol, Self

from obk_cli.errors import CommandFailedError, MisuseError
from obk_cli.workspace.overlay import overlay_prefixes, with_overlays
from obk_cli.workspace.package_index import find_workspace
from obk_testing.sweep.cases import FoundTest, Row, SweepCase
from obk_testing.sweep.worker import Hello, WorkerSettings

__all__ = ["Engine", "LocalEngine", "Placed", "RestartingWorker", "WorkerProcess"]

_CASES_A_WORKER: Final = 200
"""Number of cases after which a worker is replaced, because every trial leaks 0.3 MB."""
_ATTEMPTS: Final = 2
_START_S: Final = 300.0
"""Limit for a worker to load the stack and to collect the tests [s]."""
_END_S: Final = 10.0
"""Timeout for a worker to exit after its last case [s]."""
_NOT_FOUND: Final = "ERROR: not found: "
"""What pytest prints before the id of a test that does not exist."""
_ENVIRONMENT: Final = {
    "PYTHONHASHSEED": "0",
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF",
    "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",  # a killed worker would leave files in /dev/shm
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """A result and where it was computed."""

    row: Row
    note: str = ""
    """What is special about the worker."""


class Engine(Protocol):
    """Runs cases."""

    def map(self, cases: Iterable[SweepCase]) -> Iterator[Placed]:
        """Yield the results of cases as they finish."""

    def close(self) -> None:
        """Stop all workers, immediately if they are busy."""


class _WorkerDiedError(Exception):
    """A worker ended in the middle of a case; the message says how."""


class _TimeLimitError(Exception):
    """A case exceeded its time limit; its worker was killed."""


class WorkerProcess:
    """A process that runs one case at a time."""

    def __init__(self, config: Path, tests: Sequence[str], scratch: Path) -> None:
        """Start the process, and wait until it has collected the tests.

        Args:
            config: absolute path.
            tests: files, folders or tests for pytest, absolute paths.
            scratch: the folder for its temporary files.

        Raises:
            CommandFailedError: it cannot collect the tests.
            MisuseError: a test does not exist.
        """
        self.cases = 0
        self._resources = ExitStack()
        # This process removes the folder, because a killed worker leaves its files behind.
        folder = self._resources.enter_context(
            tempfile.TemporaryDirectory(prefix="worker-", dir=scratch, ignore_cleanup_errors=True)
        )
        self._errors = self._resources.enter_context(
            (Path(folder) / "errors").open("w+", encoding="utf-8", errors="replace")
        )
        # A Dask worker does not have the sweep's environment variables.
        overlays = overlay_prefixes([find_workspace(config.parent)])
        environment = with_overlays(os.environ, overlays)
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-m", "obk_testing.sweep.worker"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            cwd=config.parent,
            env={**environment, **_ENVIRONMENT, "TMPDIR": folder, "ROS_LOG_DIR": folder},
        )
        try:
            settings = WorkerSettings(config=str(config), tests=tuple(tests), parent=os.getpid())
            hello = self._ask(asdict(settings), _START_S)
        except (_WorkerDiedError, _TimeLimitError) as error:
            _, missing, what = " ".join(self._printed()).rpartition(_NOT_FOUND)
            self.close()
            if missing:
                raise MisuseError(f"the test does not exist: {what}") from error
            reason = str(error) or f"it takes longer than {_START_S:g} s"
            raise CommandFailedError(f"a worker of the sweep cannot start: {reason}") from error
        except BaseException:
            self.close()
            raise
        tests_found = tuple(FoundTest(**each) for each in hello["tests"])
        self.hello = Hello(**{**hello, "tests": tests_found, "files": tuple(hello["files"])})

    def run(self, case: SweepCase, limit_s: float) -> Row:
        """Run a case.

        Args:
            case: the case.
            limit_s: maximum wall time [s].

        Raises:
            _WorkerDiedError: the process ended.
            _TimeLimitError: the case exceeded the limit; the process was killed.
        """
        self.cases += 1
        return Row(**self._ask(asdict(case), limit_s))

    def kill(self) -> None:
        """Kill the process; a running case fails."""
        self._process.kill()

    def close(self) -> None:
        """Let the process exit, and remove its files."""
        with self._resources:
            assert self._process.stdin is not None
            assert self._process.stdout is not None
            try:
                self._process.stdin.close()
                self._process.wait(_END_S)
            except (OSError, subprocess.TimeoutExpired):
                self._process.kill()
                self._process.wait()
            self._process.stdout.close()

    def _ask(self, data: Mapping[str, Any], limit_s: float | None = None) -> dict[str, Any]:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        try:
            self._process.stdin.write(json.dumps(data) + "\n")
            self._process.stdin.flush()
            if limit_s is not None:
                # Nothing is buffered here: a worker writes one line per line that it reads.
                answers = select.poll()
                answers.register(self._process.stdout, select.POLLIN)
                if not answers.poll(limit_s * 1e3):
                    self._process.kill()
                    raise _TimeLimitError
            line = self._process.stdout.readline()
        except OSError:
            line = ""
        if not line.endswith("\n"):
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(
                    _END_S
                )  # its own exit code is more informative than that of a kill
            self._process.kill()
            raise _WorkerDiedError(self._end())
        answer: dict[str, Any] = json.loads(line)
        return answer

    def _end(self) -> str:
        """Describe how the process ended, with the last line that it printed."""
        code = self._process.wait()
        how = f"exit code {code}"
        if code < 0:
            how = f"signal {-code} ({signal.Signals(-code).name})"
        lines = self._printed()
        return f"{how}: {lines[-1]}" if lines else how

    def _printed(self) -> list[str]:
        self._errors.seek(0)
        return [line.strip() for line in self._errors.read().splitlines() if line.strip()]


class RestartingWorker:
    """Runs cases in a worker that is replaced if it dies or hangs, and after many cases."""

    def __init__(
        self,
        config: Path,
        tests: Sequence[str],
        scratch: Path,
        *,
        limit_s: float,
        first: WorkerProcess | None = None,
    ) -> None:
        """Create it, optionally with a first worker.

        Args:
            config: absolute path.
            tests: as for `WorkerProcess`.
            scratch: as for `WorkerProcess`.
            limit_s: maximum wall time of a case [s].
            first: a worker that has already started.
        """
        self._config, self._tests, self._scratch = config, tests, scratch
        self._limit_s = limit_s
        self._worker = first
        self._is_closed = False

    def run(self, case: SweepCase) -> Row:
        """Run a case, and retry once if the worker dies."""
        how = ""
        for _ in range(_ATTEMPTS):
            worker = self._started()
            try:
                return worker.run(case, self._limit_s)
            except _TimeLimitError:
                self._drop()
                why = f"it did not finish within {self._limit_s:g} s of wall time (`--case-limit`)"
                return Row(
                    key=case.key,
                    outcome="failed",
                    why=why,
                    seconds=self._limit_s,
                    worker=socket.gethostname(),
                )
            except _WorkerDiedError as error:
                how = str(error)
                self._drop()
                if self._is_closed:
                    break
        why = f"its worker died {_ATTEMPTS} times: {how}"
        return Row(key=case.key, outcome="died", why=why, worker=socket.gethostname())

    def kill(self) -> None:
        """Kill the worker; thread-safe."""
        self._is_closed = True
        if self._worker is not None:
            self._worker.kill()

    def close(self) -> None:
        """Stop the worker."""
        self._is_closed = True
        self._drop()

    def _started(self) -> WorkerProcess:
        if self._worker is not None and self._worker.cases >= _CASES_A_WORKER:
            self._drop()
        if self._worker is None:
            self._worker = WorkerProcess(self._config, self._tests, self._scratch)
        return self._worker

    def _drop(self) -> None:
        worker, self._worker = self._worker, None
        if worker is not None:
            worker.close()


class LocalEngine:
    """Worker processes on this machine."""

    def __init__(
        self,
        config: Path,
        tests: Sequence[str],
        scratch: Path,
        *,
        workers: int,
        limit_s: float,
        first: WorkerProcess | None = None,
    ) -> None:
        """Create it, optionally with a first worker; the others start with the first case.

        Args:
            config: absolute path.
            tests: as for `WorkerProcess`.
            scratch: as for `WorkerProcess`.
            workers: number of workers.
            limit_s: maximum wall time of a case [s].
            first: a worker that has already started.
        """
        firsts = (first, *(None for _ in range(workers - 1)))
        self._workers = [
            RestartingWorker(config, tests, scratch, limit_s=limit_s, first=each) for each in firsts
        ]
        self._threads: list[threading.Thread] = []
        self._waiting: deque[SweepCase] = deque()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def map(self, cases: Iterable[SweepCase]) -> Iterator[Placed]:
        """Yield the results of cases as they finish."""
        self._waiting = deque(cases)
        results: queue.SimpleQueue[Row | BaseException] = queue.SimpleQueue()
        count = len(self._waiting)
        # A worker ends with the thread that started it, so threads live as long as workers.
        for worker in self._workers[:count]:
            thread = threading.Thread(target=self._serve, args=[worker, results], daemon=True)
            self._threads.append(thread)
            thread.start()
        for _ in range(count):
            result = results.get()
            if isinstance(result, BaseException):
                raise result
            yield Placed(row=result)

    def close(self) -> None:
        """Stop all workers, immediately if they are busy."""
        self._waiting.clear()
        for worker in self._workers:
            if self._threads:
                worker.kill()
        for thread in self._threads:
            thread.join()
        for worker in self._workers:
            worker.close()

    def _serve(
        self, worker: RestartingWorker, results: "queue.SimpleQueue[Row | BaseException]"
    ) -> None:
        try:
            while (case := self._next_case()) is not None:
                results.put(worker.run(case))
        except BaseException as error:
            results.put(error)
        worker.close()

    def _next_case(self) -> SweepCase | None:
        try:
            return self._waiting.popleft()
        except IndexError:
            return None
