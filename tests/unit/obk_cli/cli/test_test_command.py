"""The tests that `obk test` runs."""

from pathlib import Path

import pytest

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
