"""`obk test` in its own processes: the output of a failed test, and how to repeat it."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import pytest

from obelisk_recordings.run import open_run
from obelisk_recordings.summary import read_bag
from obk_testing.recording import STATE_TOPIC

from ..waiting import DEADLINE_S  # noqa: TID252 - shared by folders of tests
from .stack import OBK

pytestmark = [pytest.mark.ros, pytest.mark.mujoco]

TESTS = """
from pathlib import Path

import pytest

LIMIT = float((Path(__file__).parent / "limit").read_text())
calls = []


def test_it_stays(stack, seed):
    robot = stack("../dummy.yaml", seed=seed)
    robot.push("link1", [1.0, 0.0, 0.0], duration=0.05)
    run = robot.run(0.2)
    assert len(run["/obelisk/dummy/est"].q_joints) > 100
    assert abs(run.joint("joint1")[-1]) < LIMIT + 10 * seed


def test_two_trials(stack):
    one, two = stack(), stack()
    one.run(0.05)
    two.run(0.05)
    assert LIMIT > 0


def test_not_repeatable(stack):
    calls.append(None)
    stack("../dummy.yaml").run(0.01 * len(calls))
"""


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return obk_in(folder, "test", "dummy.yaml", *arguments)


def obk_in(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [OBK, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=2 * DEADLINE_S,
        check=False,
    )


@pytest.fixture
def folder(tmp_path: Path, repository: Path) -> Path:
    """The dummy stack with tests that fail."""
    shutil.copytree(
        repository / "examples" / "dummy",
        tmp_path / "dummy",
        ignore=shutil.ignore_patterns("build"),
    )
    tests = tmp_path / "dummy" / "tests"
    shutil.rmtree(tests)  # the example has its own tests
    tests.mkdir()
    (tests / "limit").write_text("-1")
    (tests / "test_it.py").write_text(TESTS)
    return tmp_path / "dummy"


def digest(path: Path) -> str:
    return read_bag(path).metadata["obelisk"]["digest"]


def test_a_failed_test_leaves_everything_needed_to_repeat_it(folder: Path) -> None:
    """Two processes ran the test; alone it has the same result."""
    options = ("--seeds", "2", "-j", "2", "--junitxml", "report.xml")
    done = run(folder, *options, "-k", "stays or trials")
    assert done.returncode == 1, done.stdout + done.stderr
    kept = folder / "build" / "obk-test"
    recording = kept / "test_it-test_it_stays-seed0.mcap"
    assert {path.name for path in kept.glob("*.mcap")} == {
        recording.name,
        "test_it-test_two_trials.1.mcap",
        "test_it-test_two_trials.2.mcap",
    }
    assert recording.with_suffix(".png").is_file()
    bag = read_bag(recording)
    assert bag.is_complete
    assert bag.metadata["obelisk"]["seed"] == "0"
    assert {"plan.json", "schedule.json", "interventions.json"} <= bag.attachments.keys()
    assert len(open_run(recording)[STATE_TOPIC]) == 200
    report = ElementTree.parse(folder / "report.xml").getroot()
    assert [*report.iter("failure")]

    (again,) = re.findall(r"again: (obk test .*it_stays.*)", done.stdout)
    first = digest(recording)
    recording.unlink()
    repeated = obk_in(folder, *shlex.split(again)[1:])
    assert repeated.returncode == 1
    assert "0 of 1" in repeated.stdout
    assert digest(recording) == first

    (folder / "tests" / "limit").write_text("10")
    passed = obk_in(folder, *shlex.split(again)[1:])
    assert passed.returncode == 0, passed.stdout
    assert not recording.exists()


def test_a_repeated_test_takes_options_of_pytest_but_no_other_tests(folder: Path) -> None:
    (folder / "tests" / "limit").write_text("10")
    again = ("--again", "tests/test_it.py::test_two_trials")
    done = run(folder, *again, "--", "--durations", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "slowest" in done.stdout
    assert "1 of 1" in done.stdout
    assert run(folder, *again, "tests", "--", "-s").returncode == 2


def test_twice_finds_irreproducible_tests(folder: Path) -> None:
    (folder / "tests" / "limit").write_text("10")
    done = run(folder, "--twice")
    assert done.returncode == 1
    assert re.search("test_it_stays +1 of 1", done.stdout)
    assert re.search("test_two_trials +1 of 1", done.stdout)
    assert re.search("test_not_repeatable +0 of 1", done.stdout)
    assert "a second run of this test differs: first at 0.011000 s: " in done.stdout


def test_a_time_limit_leaves_out_the_trials_that_are_left(folder: Path) -> None:
    (folder / "tests" / "limit").write_text("10")
    done = run(folder, "tests/test_it.py", "-k", "stays or two", "--seeds", "5", "--time-limit=0s")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "1 of 6 tests ran" in done.stdout
    assert run(folder, "--time-limit", "soon").returncode == 2


def test_a_config_without_tests_gets_a_smoke_test(folder: Path) -> None:
    shutil.rmtree(folder / "tests")
    done = run(folder)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"5 s of dummy at [\d.]+x: 3 nodes, \d topics, .*twice the same", done.stdout)
    assert not [*folder.glob("build/obk-test/*")]


def test_hardware_is_rejected_without_a_traceback(repository: Path, tmp_path: Path) -> None:
    config = repository / "examples" / "hardware" / "hardware.yaml"
    done = obk_in(tmp_path, "test", str(config), "--output", str(tmp_path), "smoke")
    assert done.returncode == 1
    assert "is hardware" in done.stdout
    assert "Traceback" not in done.stdout + done.stderr


def test_a_test_that_ends_the_process_is_an_error_and_a_sweep_keeps_its_recording(
    folder: Path,
) -> None:
    test = folder / "tests" / "test_end.py"
    test.write_text(
        "import os\n\ndef test_fails(stack):\n    stack().run(0.01)\n    assert 0\n\n"
        "def test_ends(stack):\n    os._exit(0)\n"
    )
    done = run(folder, str(test))
    assert done.returncode == 1
    assert "ended with exit code 0 before its tests did" in done.stderr
    kept = folder / "build" / "obk-test" / "test_end-test_fails.mcap"
    assert kept.is_file()
    swept = obk_in(folder, "sweep", "dummy.yaml", f"{test}::test_fails", "-j", "1")
    assert swept.returncode == 1, swept.stdout + swept.stderr
    assert kept.is_file()


def test_a_test_that_sets_a_parameter_or_the_keyframe_itself_does_not_use_the_override(
    folder: Path,
) -> None:
    (folder / "tests" / "test_it.py").write_text(
        "import pytest\n\n"
        'OWN = [{}, {"parameters": {"robot": {"ic_keyframe": "ic"}}}, {"keyframe": "ic"}]\n\n'
        '@pytest.mark.parametrize("own", OWN)\n'
        "def test_it(stack, own):\n    stack(**own).run(0.01)\n"
    )
    text = (folder / "dummy_new.yaml").read_text()
    (folder / "dummy.yaml").write_text(text)
    done = run(folder, "--set", "robot[0].params.ic_keyframe=ic")
    assert done.returncode == 0, done.stdout + done.stderr
    noted = re.findall(r"note: .*ic_keyframe.* test_it\[(own\d)\]", done.stdout.replace("::", " "))
    assert noted == ["own1", "own2"]


def test_an_empty_selection_and_an_unknown_test_are_misuse(folder: Path) -> None:
    assert run(folder, "-k", "nothing_at_all").returncode == 2
    assert run(folder, "--again", "tests/no.py::test_x[seed1]").returncode == 2
