import keyword

import pytest
from hypothesis import given
from hypothesis import strategies as st

from obk_cli.scaffold.kinds import LONGEST_NAME, check_name, suggest_name

from .owners import no_owner


@pytest.mark.parametrize("name", ["foo", "foo_bar", "leg2_controller", "x1", "a" * LONGEST_NAME])
def test_lower_snake_case_is_taken(name: str) -> None:
    assert check_name(name, kind="controller", owner_of=no_owner) is None


@pytest.mark.parametrize(
    ("name", "suggestion"),
    [
        ("FooBar", "foo_bar"),
        ("fooBar", "foo_bar"),
        ("foo-bar", "foo_bar"),
        ("foo bar", "foo_bar"),
        ("foo__bar", "foo_bar"),
        ("foo_", "foo"),
        ("_foo", "foo"),
        ("2fast", "fast"),
        ("PDController", "pd_controller"),
        ("füß", "f_controller"),
        ("a", "a_controller"),
        ("", "my_controller"),
        ("42", "my_controller"),
        ("foo\n", "foo"),
    ],
)
def test_an_invalid_name_is_rejected_with_the_nearest_valid_one(name: str, suggestion: str) -> None:
    problem = check_name(name, kind="controller", owner_of=no_owner)
    assert problem is not None
    assert problem.help == f"try `{suggestion}`"


@pytest.mark.parametrize("name", ["../x_y", "/x_y", "a/x_y", "..", "x_y/", "a\\x_y"])
def test_a_path_is_rejected_as_a_path(name: str) -> None:
    problem = check_name(name, kind="estimator", owner_of=no_owner)
    assert problem is not None
    assert problem.sentence == f"the name `{name}` is a path, expected a name"
    assert problem.help is not None
    assert problem.help.endswith("choose the folder with --dest DIR")


@pytest.mark.parametrize("name", ["class", "lambda", "import"])
def test_a_keyword_is_rejected(name: str) -> None:
    problem = check_name(name, kind="controller", owner_of=no_owner)
    assert problem is not None
    assert problem.sentence == f"the name `{name}` is a Python keyword"
    assert problem.help == f"try `{name}_controller`"


@pytest.mark.parametrize("name", ["src", "build", "install", "log", "test", "setup"])
def test_a_name_with_a_meaning_in_workspaces_is_rejected(name: str) -> None:
    problem = check_name(name, kind="controller", owner_of=no_owner)
    assert problem is not None
    assert problem.sentence.endswith("has another meaning in workspaces and packages")
    assert problem.help == f"try `{name}_controller`"


def test_a_name_in_use_is_rejected_with_its_owner() -> None:
    problem = check_name("json", kind="controller", owner_of=lambda name: f"the {name} module")
    assert problem is not None
    assert problem.sentence == "the name `json` is taken: it is the json module"


def test_a_name_that_is_too_long_is_rejected() -> None:
    problem = check_name("a" * (LONGEST_NAME + 1), kind="controller", owner_of=no_owner)
    assert problem is not None
    assert "has 41 characters; expected at most 40" in problem.sentence


@given(st.text(max_size=60))
def test_a_suggestion_is_always_a_name_that_would_be_taken(name: str) -> None:
    """REP 144: lower case, digits and underscores, a letter first, two characters at least."""
    suggestion = suggest_name(name, kind="controller")
    assert not keyword.iskeyword(suggestion)
    assert check_name(suggestion, kind="controller", owner_of=no_owner) is None
