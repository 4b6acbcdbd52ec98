"""Run the cases of a sweep on a Dask cluster, on this machine or several.

Every Dask worker runs cases in separate processes, like `LocalEngine`. It uses the workspace at the
same path if it has the same files there, otherwise a copy that the sweep sends.
"""

import hashlib
import io
import os
import queue
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, suppress
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final, Self

import dask
from distributed import Client, LocalCluster, Worker, as_completed, get_worker
from distributed.diagnostics.plugin import WorkerPlugin
from distributed.scheduler import KilledWorker

from obk_cli.errors import CommandFailedError
from obk_cli.workspace.overlay import FOLDER as MESSAGES
from obk_cli.workspace.overlay import overlay_folder
from obk_cli.workspace.package_index import find_workspace
from obk_testing.sweep.cases import Row, SweepCase
from obk_testing.sweep.engines import Placed, RestartingWorker
from obk_testing.sweep.worker import machine

__all__ = ["DaskEngine"]

_NOT_SHIPPED: Final = frozenset(
    {
        *(".git", ".venv", "__pycache__", "build", "install", "log", ".pytest_cache"),
        *("node_modules", MESSAGES),
    }
)
_CONNECT_S: Final = 10


class DaskEngine:
    """The workers of a Dask cluster."""

    def __init__(
        self,
        config: Path,
        tests: Sequence[str],
        scratch: Path,
        *,
        scheduler: str | None,
        workers: int,
        limit_s: float,
        probe: SweepCase,
        digest: str,
        is_shipped: bool = False,
    ) -> None:
        """Connect to the cluster, and prepare every worker.

        Args:
            config: absolute path.
            tests: as for `WorkerProcess`.
            scratch: a folder for temporary files.
            scheduler: address; None to start a cluster on this machine.
            workers: number of workers in that cluster.
            limit_s: maximum wall time of a case [s].
            probe: the case that every worker runs first.
            digest: digest of the probe case on this machine; empty if it started no trial.
            is_shipped: whether to use the copy of the workspace even if the same files exist.

        Raises:
            CommandFailedError: the scheduler does not respond.
        """
        self._digest = digest
        self._resources = ExitStack()
        try:
            address = scheduler or self._start_cluster(workers, scratch)
            self._client: Any = self._resources.enter_context(
                Client(address, timeout=_CONNECT_S, set_as_default=False)
            )
        except OSError as error:
            self._resources.close()
            raise CommandFailedError(
                f"the Dask scheduler at {scheduler} does not respond: {error}",
                help="run `dask scheduler` to start one, and `dask worker ADDRESS` for a worker",
            ) from error
        workspace = find_workspace(config.parent)
        runner = _CaseRunner(
            config=str(config),
            tests=tuple(tests),
            workspace=str(workspace),
            archive=b"" if scheduler is None and not is_shipped else zipped(workspace),
            is_shipped=is_shipped,
            limit_s=limit_s,
            probe=probe,
        )
        self._name = runner.name
        self._client.register_plugin(runner, name=runner.name)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def map(self, cases: Iterable[SweepCase]) -> Iterator[Placed]:
        """Yield the results of cases as they finish."""
        waiting = iter(cases)
        submitted: dict[str, SweepCase] = {}

        def submit(count: int) -> list[Any]:
            futures = []
            for case in islice(waiting, count):
                future = self._client.submit(_run_case, self._name, case, pure=False)
                submitted[future.key] = case
                futures.append(future)
            return futures

        # Submit more cases than can run, so that no worker waits for the network.
        ahead = 2 * max(1, sum(self._client.nthreads().values()))
        futures = as_completed(submit(ahead), loop=self._client.loop)
        for future in futures:
            yield self._placed(submitted.pop(future.key), future)
            futures.update(submit(1))

    def close(self) -> None:
        """Stop the workers' processes, and the cluster if it was started here."""
        # If the cluster has ended, there are no workers to clean up.
        with suppress(OSError, TimeoutError, ValueError):
            self._client.unregister_worker_plugin(self._name)
        self._resources.close()

    def _start_cluster(self, workers: int, scratch: Path) -> Any:
        folder = TemporaryDirectory(prefix="dask-", dir=scratch, ignore_cleanup_errors=True)
        with dask.config.set({"distributed.admin.system-monitor.gil.enabled": False}):
            return self._resources.enter_context(
                LocalCluster(
                    n_workers=workers,
                    threads_per_worker=1,
                    dashboard_address=None,
                    memory_limit=0,
                    local_directory=self._resources.enter_context(folder),
                )
            )

    def _placed(self, case: SweepCase, future: Any) -> Placed:
        error = future.exception()
        if isinstance(error, KilledWorker):
            died = f"its Dask workers died, the last one at {error.last_worker.address}"
            return Placed(row=Row(key=case.key, outcome="died", why=died))
        if error is not None:
            raise error
        row, probe, cpu = future.result()
        if probe.digest == self._digest:
            return Placed(row=row)
        name = probe.worker.partition(":")[0]
        if not probe.digest:
            raise CommandFailedError(
                f"the Dask worker on {name} cannot run the first case: {probe.why}",
                help="install the same Python, packages and messages as on this machine",
            )
        note = f"worker {name} is not bitwise equal (CPU {cpu}): its results are statistics"
        return Placed(row=row, note=f"{note}, not replays")


class _CaseRunner(WorkerPlugin):
    """Runs the cases of a sweep in a Dask worker."""

    def __init__(
        self,
        *,
        config: str,
        tests: tuple[str, ...],
        workspace: str,
        archive: bytes,
        is_shipped: bool,
        limit_s: float,
        probe: SweepCase,
    ) -> None:
        identity = repr((config, tests, probe, os.getpid())).encode() + archive
        self.name = f"obk-sweep-{hashlib.sha256(identity).hexdigest()[:12]}"
        self._config, self._tests, self._workspace = config, tests, workspace
        self._archive, self._is_shipped, self._probe = archive, is_shipped, probe
        self._limit_s = limit_s

    def setup(self, worker: Worker) -> None:
        """Prepare a Dask worker; called by Dask on each worker, including those that join later."""
        self._scratch = Path(worker.local_directory) / self.name
        self._scratch.mkdir(exist_ok=True)
        if self._is_shipped or not self._has_same_files():
            self._unpack()
        self._idle: queue.SimpleQueue[RestartingWorker] = queue.SimpleQueue()
        self._all: list[RestartingWorker] = []
        self._probed: Row | None = None

    def teardown(self, worker: Worker) -> None:  # noqa: ARG002 - Dask's
        """Stop the processes; called by Dask."""
        for each in self._all:
            each.kill()
            each.close()

    def run(self, case: SweepCase) -> tuple[Row, Row, str]:
        """Run a case; also return the result of the probe case on this machine, and its CPU."""
        try:
            process = self._idle.get_nowait()
        except queue.Empty:
            process = RestartingWorker(
                Path(self._config), self._tests, self._scratch, limit_s=self._limit_s
            )
            self._all.append(process)
        if self._probed is None:
            self._probed = process.run(self._probe)
        row = process.run(case)
        self._idle.put(process)
        return row, self._probed, machine()["cpu"]

    def _has_same_files(self) -> bool:
        if not self._archive:
            return True
        with zipfile.ZipFile(io.BytesIO(self._archive)) as archive:
            for name in archive.namelist():
                path = Path(self._workspace) / name
                if not path.is_file() or path.read_bytes() != archive.read(name):
                    return False
        return True

    def _unpack(self) -> None:
        folder = self._scratch / "workspace"
        with zipfile.ZipFile(io.BytesIO(self._archive)) as archive:
            archive.extractall(folder)

        def moved(path: str) -> str:
            return str(folder / Path(path).relative_to(self._workspace))

        self._config, self._tests = moved(self._config), tuple(map(moved, self._tests))


def _run_case(name: str, case: SweepCase) -> tuple[Row, Row, str]:
    runner: Any = get_worker().plugins[name]
    result: tuple[Row, Row, str] = runner.run(case)
    return result


def zipped(workspace: Path) -> bytes:
    """Zip the files of a workspace and its compiled messages, without other build results."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for folder, folders, files in os.walk(workspace):
            folders[:] = sorted(name for name in folders if name not in _NOT_SHIPPED)
            for name in sorted(files):
                path = Path(folder) / name
                if path.is_file():
                    archive.write(path, path.relative_to(workspace))
        overlay = overlay_folder(workspace)
        for path in sorted(overlay.rglob("*")):  # a link, which `os.walk` does not follow
            if path.is_file() and "__pycache__" not in path.parts:
                archive.write(path, path.relative_to(workspace))
    return data.getvalue()
