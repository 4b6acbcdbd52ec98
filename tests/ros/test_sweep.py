"""`obk sweep` with real workers: same results, interruption, resumption, reports."""

import json
import os
import shlex
import shutil
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from obk_cli.process.signals import hold_interrupts
from obk_testing.programs import LoadedStacks
from obk_testing.sweep.cases import FoundTest, SweepCase, make_cases
from obk_testing.sweep.engines import LocalEngine, WorkerProcess
from obk_testing.sweep.worker import WorkerSettings
from obk_testing.trial import StackTrial

from .stack import OBK, eventually, marked, obk
from .workspace import make_workspace

pytestmark = pytest.mark.ros

SIGMA = "robot.sim[0].sensor_settings[1].noise.joint_pos.sigma"
PERIOD = "control.timers[0].timer_period_sec"
NOISY = "/obelisk/dummy/obk_joint_encoders"
TESTS = f"""\
import os
import signal
from pathlib import Path

import pytest

FLAG = Path(__file__).with_name("killed")


def test_it_stays(stack, seed, record_property):
    if seed == 1 and not FLAG.exists():
        FLAG.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    run = stack("../dummy.yaml", seed=seed, watch=["{NOISY}"]).run(0.1)
    record_property("end", run.qpos[-1, 0].astype("float32"))
    assert seed != 3, "three"
    assert not run.faults


@pytest.fixture(scope="module")
def calls():
    return []


@pytest.mark.parametrize("late_ms", [0, 2])
def test_it_stands_delays(stack, late_ms, calls):
    calls.append(late_ms)
    dummy = stack("../dummy.yaml")
    dummy.delay("/obelisk/dummy/est", late_ms / 1000)
    dummy.run(0.05)
    assert calls == [late_ms]


def test_without_a_stack():
    assert False


@pytest.mark.skipif(True, reason="not now")
def test_later(stack, seed):
    assert False
"""
STAYS = FoundTest(node_id="tests/test_dummy.py::test_it_stays[seed0]", takes_seed=True)


@pytest.fixture
def config(repository: Path, tmp_path: Path) -> Path:
    """The dummy with noise and tests, in its own folder."""
    dummy = repository / "examples" / "dummy"
    for name in ("dummy.xml", "dummy_params.txt"):
        shutil.copy(dummy / name, tmp_path)
    text = (dummy / "dummy_new.yaml").read_text()
    plain = "sensor_names: {joint_pos: jointpos, joint_vel: jointvel}\n"
    assert text.count(plain) == 1
    noisy = f"{plain}        noise: {{joint_pos: {{sigma: 0.01}}}}\n"
    path = tmp_path / "dummy.yaml"
    path.write_text(text.replace(plain, noisy))
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_dummy.py").write_text(TESTS)
    return path


def digests(folder: Path) -> dict[int, str]:
    """Seed -> digest of the passed test with a seed."""
    with closing(sqlite3.connect(folder / "sweep.sqlite")) as database:
        rows = "SELECT seed, digest FROM rows WHERE digest != '' AND seed IS NOT NULL"
        return dict(database.execute(rows))


def run_alone(config: Path, cases: list[SweepCase], workers: int = 1) -> dict[int | None, str]:
    scratch = config.parent / "scratch"
    scratch.mkdir(exist_ok=True)
    tests = (str(config.parent / "tests"),)
    seeds = {case.key: case.seed for case in cases}
    with LocalEngine(config, tests, scratch, workers=workers, limit_s=60.0) as engine:
        rows = [placed.row for placed in engine.map(cases)]
    assert not list(scratch.iterdir())
    return {seeds[row.key]: row.digest for row in rows}


@pytest.mark.slow
def test_a_sweep_runs_reports_and_has_the_results_of_any_order(config: Path) -> None:
    folder = config.parent / "out"
    command = ("sweep", config, "--seeds", "5", "-j", "2", "--output", folder, "--format", "json")
    result = obk(*command)
    assert result.returncode == 1, result.stderr
    assert "skipping 1 test" in result.stderr
    summary = json.loads(result.stdout)
    assert (summary["cases"], summary["done"]) == (12, 12)
    # The worker that was killed in seed 1 lost no case.
    assert summary["outcomes"] == {"passed": 6, "failed": 1, "skipped": 5}
    (failed,) = summary["failed"]
    assert failed["seed"] == 3
    assert "three" in failed["why"]
    assert failed["metrics"].keys() == {"end"}
    assert isinstance(failed["metrics"]["end"], float)
    assert "test_it_stays[seed3]" in failed["again"]
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "sweep.sqlite"]

    # Nothing runs again, and the report is the same.
    page = (folder / "report.html").read_text()
    again = obk(*command)
    assert (again.returncode, again.stdout) == (1, result.stdout)
    assert (folder / "report.html").read_text() == page

    # With one worker, in reverse order.
    cases = [*make_cases([STAYS], seeds=5)]
    assert run_alone(config, cases[::-1]) == digests(folder)

    # Results of a test that has changed belong to another sweep.
    (config.parent / "tests" / "test_dummy.py").write_text(TESTS.replace("three", "four"))
    changed = obk(*command)
    assert changed.returncode == 2
    assert "test_dummy.py changed" in changed.stderr


def test_a_killed_sweep_is_resumed(config: Path) -> None:
    folder = config.parent / "out"
    command = ["sweep", str(config), "tests/test_dummy.py::test_it_stays", "--seeds", "9"]
    command += ["-j", "2", "--output", str(folder), "--vary", f"{SIGMA}=0.001..0.1"]
    sweep = subprocess.Popen([OBK, *command], start_new_session=True, stderr=subprocess.DEVNULL)
    eventually(lambda: folder.exists() and count(folder) >= 2, "two results")
    os.killpg(sweep.pid, signal.SIGKILL)
    sweep.wait()
    eventually(lambda: not marked(), "the end of the workers")
    before = digests(folder)
    result = obk(*command)
    assert "continuing" in result.stderr
    assert result.returncode == 1
    assert before.items() <= digests(folder).items()
    assert len(set(digests(folder).values())) == 9
    assert sorted(path.name for path in folder.iterdir()) == ["report.html", "sweep.sqlite"]


KEEPS_DIGESTS = f"""\
import os
from pathlib import Path


def test_digest(stack, seed):
    digest = stack("../dummy.yaml", seed=seed, watch=["{NOISY}"]).run(0.1).digest()
    worker = os.environ.get("PYTEST_XDIST_WORKER", "alone")
    Path(__file__).with_name(f"{{worker}}-seed{{seed}}").write_text(digest)
"""


@pytest.mark.slow
def test_a_trial_has_one_digest_under_xdist_in_the_pool_and_alone(
    config: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)  # this test's own worker
    tests, folder = config.parent / "tests", config.parent / "out"
    (tests / "test_dummy.py").write_text(KEEPS_DIGESTS)

    def kept(worker: str) -> dict[int, str]:
        paths = tests.glob(f"{worker}-seed*")
        return {int(path.name.partition("seed")[2]): path.read_text() for path in paths}

    assert obk("sweep", config, "--seeds", "4", "-j", "2", "--output", folder).returncode == 0
    pool = digests(folder)
    assert pool.keys() == {0, 1, 2, 3}
    assert len(set(pool.values())) == 4
    assert kept("alone") == pool
    for path in tests.glob("alone-*"):
        path.unlink()

    assert obk("test", config, "--seeds", "4", "-j", "2").returncode == 0
    assert kept("gw[01]") == pool
    again = obk("test", config, "--again", "tests/test_dummy.py::test_digest[seed2]")
    assert again.returncode == 0, again.stdout
    assert kept("alone") == {2: pool[2]}


def count(folder: Path) -> int:
    try:
        with closing(sqlite3.connect(folder / "sweep.sqlite")) as database:
            return int(database.execute("SELECT count(*) FROM rows").fetchone()[0])
    except sqlite3.Error:
        return 0  # not written yet


@pytest.mark.slow
def test_workers_end_with_the_sweep(config: Path) -> None:
    folder = config.parent / "out"
    command = [OBK, "sweep", str(config), "--seeds", "500", "-j", "1", "--output", str(folder)]
    for number in (signal.SIGKILL, signal.SIGINT):
        sweep = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        had = count(folder)
        eventually(lambda had=had: count(folder) > had, "a result")  # type: ignore[misc]
        sweep.send_signal(number)
        _, errors = sweep.communicate()
        eventually(lambda: not marked(), "the end of the workers")
    assert sweep.returncode == 130
    assert "run the same command again to continue" in errors
    assert (folder / "report.html").exists()


@pytest.mark.slow
def test_a_case_whose_worker_always_dies_is_reported(config: Path) -> None:
    tests = config.parent / "tests" / "test_dummy.py"
    tests.write_text(TESTS.replace("not FLAG.exists()", "True"))
    folder = config.parent / "out"
    result = obk(
        *("sweep", config, "tests/test_dummy.py::test_it_stays", "--seeds", "3", "-j", "1"),
        *("--output", folder, "--format", "json"),
    )
    (failed,) = json.loads(result.stdout)["failed"]
    assert (failed["seed"], failed["outcome"]) == (1, "died")
    assert "SIGKILL" in failed["why"]
    assert digests(folder).keys() == {0, 2}


@pytest.mark.slow
def test_collection_errors_are_reported(config: Path) -> None:
    tests = config.parent / "tests" / "test_dummy.py"
    tests.write_text(f"import no_such_module\n{TESTS}")
    result = obk("sweep", config, "--output", config.parent / "out")
    assert result.returncode == 1
    assert "no_such_module" in result.stderr
    assert "Traceback (most" not in result.stderr


@pytest.mark.slow
def test_one_set_of_parameters_is_swept_by_the_name_that_reports_have(config: Path) -> None:
    tests, folder = config.parent / "tests" / "test_dummy.py", config.parent / "out"
    tests.write_text(TESTS.replace("(stack, late_ms, calls)", "(stack, seed, late_ms, calls)"))
    result = obk(
        *("sweep", config, "tests/test_dummy.py::test_it_stands_delays[2]", "--seeds", "2"),
        *("-j", "1", "--output", folder, "--format", "json"),
    )
    assert result.returncode == 0, result.stderr
    (test,) = json.loads(result.stdout)["tests"]
    assert (test["test"], test["passed"]) == ("tests/test_dummy.py::test_it_stands_delays[2]", 2)
    unknown = obk("sweep", config, "tests/test_dummy.py::test_nothing", "--output", folder)
    assert unknown.returncode == 2
    assert "test_dummy.py::test_nothing" in unknown.stderr


@pytest.mark.slow
def test_another_config_of_a_test_is_an_input_without_the_varied_values(config: Path) -> None:
    folder, tests = config.parent / "out", config.parent / "tests"
    other = config.with_name("other.yaml")
    shutil.copy(config, other)
    (tests / "test_dummy.py").write_text(
        "import helper\n\ndef test_it(stack, seed):\n    helper.start(stack)\n"
    )
    helper = tests / "helper.py"
    helper.write_text('def start(stack):\n    stack("../other.yaml").run(0.01)\n')
    command = ("sweep", config, "--seeds", "2", "-j", "1", "--output", folder, "--vary")
    command += (f"{SIGMA}=0.001..0.1", "--format", "json")
    result = obk(*command)
    assert result.returncode == 0, result.stderr
    (note,) = json.loads(result.stdout)["notes"]
    assert SIGMA in note
    for path in (other, helper):
        before = path.read_text()
        path.write_text(f"{before}# changed\n")
        changed = obk(*command)
        assert changed.returncode == 2
        assert f"{path.name} changed" in changed.stderr
        path.write_text(before)
    assert obk(*command).returncode == 0


def test_a_file_that_a_test_reads_is_an_input(config: Path) -> None:
    folder, tests = config.parent / "out", config.parent / "tests"
    (tests / "test_dummy.py").write_text(
        "from pathlib import Path\n\n"
        "def test_it(stack, seed):\n"
        '    Path(__file__).with_name("table.csv").read_text()\n'
        '    stack("../dummy.yaml").run(0.01)\n'
    )
    table = tests / "table.csv"
    table.write_text("1 2\n")
    command = ("sweep", config, "-j", "1", "--output", folder, "--seeds")
    assert obk(*command, "1").returncode == 0
    assert obk(*command, "2").returncode == 0
    table.write_text("1 3\n")
    changed = obk(*command, "3")
    assert changed.returncode == 2
    assert f"{table.name} changed" in changed.stderr
    assert obk(*command, "3", "--restart").returncode == 0
    assert obk(*command, "3").returncode == 0


@pytest.mark.slow
def test_a_restart_that_cannot_run_keeps_the_results(config: Path) -> None:
    folder, tests = config.parent / "out", config.parent / "tests" / "test_dummy.py"
    command = ("sweep", config, "tests/test_dummy.py::test_it_stays", "--output", folder)
    assert obk(*command).returncode == 0
    before = digests(folder)
    tests.write_text(f"import no_such_module\n{TESTS}")
    assert obk(*command, "--restart").returncode == 1
    assert digests(folder) == before
    tests.write_text(TESTS.replace("run(0.1)", "run(0.05)"))
    unknown = obk(*command, "--restart", "--vary", f"{PERIOD}=-1..1")
    assert unknown.returncode == 2
    assert digests(folder) == before
    assert obk(*command, "--restart").returncode == 0
    assert before.keys() == digests(folder).keys()
    assert before != digests(folder)


@pytest.mark.slow
def test_a_case_that_never_ends_fails_and_does_not_stop_the_sweep(config: Path) -> None:
    tests = config.parent / "tests" / "test_dummy.py"
    endless = "        while True:\n            pass\n"
    tests.write_text(TESTS.replace("        FLAG.touch()\n", endless))
    folder = config.parent / "out"
    result = obk(
        *("sweep", config, "tests/test_dummy.py::test_it_stays", "--seeds", "3", "-j", "1"),
        *("--case-limit", "20", "--output", folder, "--format", "json"),
    )
    assert result.returncode == 1
    (failed,) = json.loads(result.stdout)["failed"]
    assert (failed["seed"], failed["outcome"]) == (1, "failed")
    assert "--case-limit" in failed["why"]
    assert "test_it_stays[seed1]" in failed["again"]
    assert digests(folder).keys() == {0, 2}
    assert not marked()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--vary", "control.params.gian=1..2"), "has no `params`"),
        (("--vary", f"{PERIOD}=-1..1"), "has errors"),
        (("--vary", f"{SIGMA}=1..2:3", "--seeds", "4"), "`--grid`"),
        (("no_tests.py",), "does not exist"),
        (("tests/test_dummy.py::test_without_a_stack",), "`stack`"),
        (("--scheduler", "tcp://127.0.0.1:9"), "--engine dask"),
        (("--case-limit", "nan"), "--case-limit nan"),
    ],
)
def test_misuse_is_found_before_anything_runs(
    config: Path, arguments: tuple[str, ...], words: str
) -> None:
    folder = config.parent / "out"
    result = obk("sweep", config, *arguments, "--output", folder)
    assert result.returncode in (1, 2)
    assert words in result.stderr
    assert not list(folder.glob("report.html"))


def test_shared_programs_give_the_results_of_a_fresh_load(config: Path) -> None:
    changed = (f"{SIGMA}=0.05", "robot.sim[0].num_steps_per_viz=8")

    def digest(stacks: LoadedStacks, *overrides: str) -> str:
        with StackTrial(stacks.get(config, overrides), seed=4, watch=[NOISY]) as trial:
            return trial.run(0.05).digest()

    shared, fresh = LoadedStacks(), LoadedStacks()
    try:
        plain = digest(shared)
        assert digest(shared, *changed) == digest(fresh, *changed) != plain
        # Another period belongs to another program.
        assert digest(shared, f"{PERIOD}=0.002") == digest(fresh, f"{PERIOD}=0.002") != plain
        assert digest(shared) == plain
    finally:
        shared.close()
        fresh.close()


def test_a_worker_without_its_parent_does_not_start(config: Path) -> None:
    settings = WorkerSettings(config=str(config), tests=(), parent=1)
    data = json.dumps({"config": settings.config, "tests": [], "parent": settings.parent})
    worker = ["-m", "obk_testing.sweep.worker"]
    result = subprocess.run(
        [OBK.with_name("python"), *worker], input=data + "\n", capture_output=True, text=True
    )
    assert (result.returncode, result.stdout) == (0, "")


DASK = """\
import json
import sys
from pathlib import Path

from obk_testing.sweep.cases import FoundTest, make_cases
from obk_testing.sweep.dask_engine import DaskEngine

if __name__ == "__main__":
    folder, node_id, digest = Path(sys.argv[1]), *sys.argv[2:]
    cases = make_cases([FoundTest(node_id=node_id, takes_seed=True)], seeds=6)
    seeds = {case.key: case.seed for case in cases}
    with DaskEngine(
        folder / "dummy.yaml",
        (str(folder / "tests"),),
        folder / "scratch",
        scheduler=None,
        workers=2,
        limit_s=60.0,
        probe=cases[0],
        digest=digest,
        is_shipped=True,
    ) as engine:
        placed = list(engine.map(cases))
    rows = [[seeds[each.row.key], each.row.digest] for each in placed]
    print(json.dumps({"rows": rows, "notes": sorted({each.note for each in placed})}))
"""


@pytest.mark.slow
def test_two_dask_workers_give_the_results_of_local_ones(config: Path) -> None:
    pytest.importorskip("distributed", reason="it is in the extra `sweep`")
    folder, test = config.parent, "tests/test_dummy.py::test_it_stays"
    local = run_alone(config, [*make_cases([STAYS], seeds=6)], workers=2)
    result = obk(
        *("sweep", config, test, "--seeds", "6", "-j", "2", "--engine", "dask"),
        *("--output", folder / "out"),
    )
    assert result.returncode == 1, result.stderr  # seed 3
    assert digests(folder / "out") == local
    assert "bitwise equal" not in result.stdout

    # From a copy of the workspace, on a machine with different results.
    (folder / "on_dask.py").write_text(DASK)
    shipped = subprocess.run(
        [sys.executable, folder / "on_dask.py", folder, STAYS.node_id, "of another CPU"],
        capture_output=True,
        text=True,
    )
    assert shipped.returncode == 0, shipped.stderr
    found = json.loads(shipped.stdout)
    assert dict(found["rows"]) == local
    (note,) = found["notes"]
    assert "statistics, not replays" in note
    assert not list((folder / "scratch").iterdir())


@pytest.mark.slow
def test_a_copy_of_the_workspace_has_its_messages_and_a_lack_is_named(config: Path) -> None:
    pytest.importorskip("distributed", reason="it is in the extra `sweep`")
    folder = config.parent
    make_workspace(folder)
    (folder / "tests" / "test_dummy.py").write_text(f"from other_msgs.msg import Word\n{TESTS}")
    (folder / "on_dask.py").write_text(DASK)
    built = obk("build", "--workspace", folder, "other_msgs")
    assert built.returncode == 0, built.stderr
    local = run_alone(config, [*make_cases([STAYS], seeds=6)])
    words = [sys.executable, folder / "on_dask.py", folder, STAYS.node_id, local[0]]
    shipped = subprocess.run(words, capture_output=True, text=True)
    assert shipped.returncode == 0, shipped.stderr
    found = json.loads(shipped.stdout)
    assert (dict(found["rows"]), found["notes"]) == (local, [""])

    shutil.rmtree(folder / ".obk")
    lacking = subprocess.run(words, capture_output=True, text=True)
    assert lacking.returncode == 1
    assert "CommandFailedError" in lacking.stderr
    assert "No module named 'other_msgs'" in lacking.stderr


@pytest.mark.slow
def test_a_worker_process_reports_its_tests(config: Path, tmp_path: Path) -> None:
    worker = WorkerProcess(config, (str(config.parent / "tests"),), tmp_path)
    try:
        assert STAYS in worker.hello.tests
        assert worker.hello.left_out == 1
        assert worker.hello.machine["python"]
    finally:
        worker.close()


@pytest.mark.slow
def test_a_config_without_tests_is_swept_by_the_smoke_test(config: Path) -> None:
    shutil.rmtree(config.parent / "tests")
    folder = config.parent / "out"
    result = obk(
        *("sweep", config, "--seeds", "2", "-j", "1", "--output", folder, "--format", "json")
    )
    assert result.returncode == 0, result.stderr
    (test,) = json.loads(result.stdout)["tests"]
    assert (test["test"], test["passed"]) == ("smoke", 2)
    assert obk("sweep", config, "smoke", "--output", folder).returncode == 0


@pytest.mark.slow
def test_the_command_of_the_report_repeats_a_case(config: Path) -> None:
    folder = config.parent / "out"
    (config.parent / "tests" / "killed").touch()
    result = obk(
        *("sweep", config, "tests/test_dummy.py::test_it_stays", "--seeds", "4", "-j", "2"),
        *("--vary", f"{SIGMA}=0.001..0.1", "--output", folder, "--format", "json"),
    )
    (failed,) = json.loads(result.stdout)["failed"]
    again = obk(*shlex.split(failed["again"])[1:])
    assert again.returncode == 1
    (recording,) = config.parent.rglob("*.mcap")
    assert failed["digest"].encode() in recording.read_bytes()


@pytest.mark.parametrize(
    "program",
    [
        ("obk_testing.sweep", '{"config": "no.yaml"}'),
        ("pytest", "-p", "obk_testing.plugin", "--end-file", "ended", "-p", "no:cacheprovider"),
    ],
    ids=["sweep", "test"],
)
def test_an_interrupt_while_a_program_starts_ends_it_quietly(
    program: tuple[str, ...], tmp_path: Path
) -> None:
    def interrupted() -> None:
        hold_interrupts()
        os.kill(os.getpid(), signal.SIGINT)

    done = subprocess.run(
        [sys.executable, "-P", "-m", *program],
        cwd=tmp_path,
        preexec_fn=interrupted,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
    )
    assert "Traceback" not in done.stdout
    interrupted_code = pytest.ExitCode.INTERRUPTED if program[0] == "pytest" else 130
    assert done.returncode == interrupted_code
