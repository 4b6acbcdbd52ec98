"""The tests that `obk test` runs."""

from pathlib import Path

import pytest

from obk_cli.cli.main import main
from obk_cli.cli.test import default_tests

USES = "def test_x(stack, seed):\n    stack()\n"
OWN = "import pytest\n@pytest.fixture\ndef stack():\n    return 1\ndef test_x(stack):\n    pass\n"


@pytest.mark.parametrize(
    ("name", "text", "is_found"),
    [
        ("test_x.py", USES, True),
        ("deeper/x_test.py", "class TestX:\n    def test_x(self, *, stack): ...\n", True),
        ("conftest.py", "def arm(stack): ...\n", True),
        ("test_x.py", "def test_x(): ...\n", False),
        ("test_x.py", OWN, False),
        ("helpers.py", USES, False),
        ("test_x.py", "def test_x(:\n", True),  # pytest reports it
    ],
)
def test_the_tests_next_to_a_config_are_those_that_use_the_fixture(
    tmp_path: Path, name: str, text: str, is_found: bool
) -> None:
    path = tmp_path / "tests" / name
    path.parent.mkdir(parents=True)
    path.write_text(text)
    assert default_tests(tmp_path) == (tmp_path / "tests" if is_found else None)


def test_a_config_without_a_folder_of_tests_has_no_tests(tmp_path: Path) -> None:
    assert default_tests(tmp_path) is None


@pytest.mark.parametrize(
    "arguments",
    [
        ("nofile.py",),
        ("smoke", "tests/nofile.py::test_it"),
        ("--junitxml", "file/report.xml"),
    ],
)
def test_what_cannot_work_is_reported_before_the_tests_run(
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("file").touch()
    with pytest.raises(SystemExit):
        main(["test", "no.yaml", *arguments])
    assert arguments[-1] in capsys.readouterr().err


def test_the_check_of_the_report_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main(["test", "no.yaml", "--junitxml", "out/report.xml"])
    assert not Path("out/report.xml").exists()
