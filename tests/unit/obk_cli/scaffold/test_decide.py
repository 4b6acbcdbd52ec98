from pathlib import PurePosixPath

from obk_cli.scaffold.decide import Action, Existing, conflicts, decide
from obk_cli.scaffold.render import RenderedFile

PATH = PurePosixPath("a/b.py")
FILE = RenderedFile(path=PATH, content=b"new")


def action(there: Existing | None, *, force: bool = False) -> Action:
    existing = {} if there is None else {PATH: there}
    (decision,) = decide([FILE], existing, force=force)
    return decision.action


def test_a_file_that_is_not_there_is_created() -> None:
    assert action(None) is Action.CREATE
    assert action(None, force=True) is Action.CREATE


def test_the_same_file_is_left_alone() -> None:
    assert action(Existing(content=b"new")) is Action.IDENTICAL
    assert action(Existing(content=b"new"), force=True) is Action.IDENTICAL


def test_another_file_is_refused_or_with_force_replaced() -> None:
    assert action(Existing(content=b"old")) is Action.CONFLICT
    assert action(Existing(content=b"old"), force=True) is Action.REPLACE


def test_what_is_no_file_is_refused_even_with_force() -> None:
    assert action(Existing(content=None, reason="it is a folder"), force=True) is Action.CONFLICT


def test_an_edit_needs_the_file_that_it_edits() -> None:
    (gone,) = decide([], {}, edits=[FILE])
    (changed,) = decide([], {PATH: Existing(content=b"old")}, edits=[FILE])
    (same,) = decide([], {PATH: Existing(content=b"new")}, edits=[FILE])
    assert [gone.action, changed.action, same.action] == [
        Action.CONFLICT,
        Action.EDIT,
        Action.IDENTICAL,
    ]
    assert gone.reason == "it is gone"


def test_conflicts_are_told_with_their_reason() -> None:
    decisions = decide([FILE], {PATH: Existing(content=b"old")})
    assert [d.reason for d in conflicts(decisions)] == ["it is there with other content"]
    assert conflicts(decide([FILE], {})) == ()
