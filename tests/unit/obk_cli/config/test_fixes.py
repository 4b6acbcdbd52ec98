"""Edits of source text: what they change, and what they leave unchanged."""

import pytest

from obk_cli.config.fixes import append_to, remove_entry, respell
from obk_cli.config.tree import Entry, Tree, TreeList, TreeMap
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.edits import Edit, apply_edits
from obk_cli.diagnostics.source import SourceFile, Span


def maps(tree: Tree) -> list[TreeMap]:
    if isinstance(tree, TreeMap):
        return [tree, *(m for entry in tree for m in maps(entry.value))]
    return [m for item in tree.items for m in maps(item)] if isinstance(tree, TreeList) else []


def entry_of(text: str, key: str) -> tuple[SourceFile, TreeMap, Entry]:
    source = SourceFile.of("f", text)
    tree = parse_source(source).tree
    assert tree is not None
    mapping, entry = next((m, e) for m in maps(tree) if (e := m.get(key)))
    return source, mapping, entry


def without(text: str, key: str) -> str:
    source, mapping, entry = entry_of(text, key)
    return apply_edits(source, remove_entry(mapping, entry))


@pytest.mark.parametrize(
    ("text", "left"),
    [
        ("a: 1\nx: 2\nb: 3\n", "a: 1\nb: 3\n"),
        ("a: 1\r\nx: 2\r\nb: 3\r\n", "a: 1\r\nb: 3\r\n"),
        ("a: 1\nx: 2", "a: 1\n"),
        ("a: 1\n  # why\nx: 'two'   # so\nb: 3\n", "a: 1\n  # why\n# so\nb: 3\n"),
        ("- x: 2\n  a: 1\n", "- a: 1\n"),
        ("- x: 2  # so\n  a: 1\n", "- # so\n  a: 1\n"),
        ("- x: 2\n\n  a: 1\n", "- a: 1\n"),
        ("- a: 1\n  x:\n- b: 2\n", "- a: 1\n- b: 2\n"),
        ("{a: 1, x: 2, b: 3}\n", "{a: 1, b: 3}\n"),
        ("{x: 2, b: 3}\n", "{b: 3}\n"),
        ("{a: 1, x: 2}\n", "{a: 1}\n"),
        ("{a: 1, x: 2 ,}\n", "{a: 1, }\n"),
        ("{x: 2}\n", "{}\n"),
        ("{a: 1,\n x: 2 # so\n}\n", "{a: 1,\n  # so\n}\n"),
        ("k: &m {a: 1, x: 2}\n", "k: &m {a: 1}\n"),
    ],
)
def test_a_key_is_taken_out_and_comments_stay(text: str, left: str) -> None:
    assert without(text, "x") == left


@pytest.mark.parametrize(
    "text",
    [
        "- x: 2\n",
        "- x: 2\n  # why\n  a: 1\n",
        "x: |\n  two\n",
        "x:\n  2\n",
        "x: [2]\n",
        "x: {y: 2}\n",
        "b: &b 2\nx: *b\n",
        "? x\n: 2\n",
        "m: &m\n  a: 1\nn:\n  <<: *m\n  x: >\n    text\n",
    ],
)
def test_lines_with_more_than_a_value_are_kept(text: str) -> None:
    assert without(text, "x") == text


def test_a_key_from_a_merge_is_kept() -> None:
    text = "m: &m {x: 2}\nn:\n  <<: *m\n"
    source, _, entry = entry_of(text, "x")
    mapping = maps(parse_source(source).tree or TreeMap((), entry.key_span))[2]
    assert remove_entry(mapping, entry) == ()


@pytest.mark.parametrize(
    ("text", "new", "after"),
    [
        ("x: old # c\n", "new", "x: new # c\n"),
        ("x: 'old'\n", "new", "x: 'new'\n"),
        ('x: "old"\n', "/a/new-1", 'x: "/a/new-1"\n'),
        ("x: old\n", "true", 'x: "true"\n'),
        ("x: old\n", "12", 'x: "12"\n'),
        ("x: 'old'\n", "it's", 'x: "it\'s"\n'),
        ("x: old\n", "a: b", 'x: "a: b"\n'),
        ("x: &a old\n", "new", "x: &a old\n"),
        ('x: "o\\x6cd"\n', "new", 'x: "o\\x6cd"\n'),
        ("x: >\n  old\n", "new", "x: >\n  old\n"),
    ],
)
def test_a_word_is_written_in_its_original_quotes(text: str, new: str, after: str) -> None:
    source, _, entry = entry_of(text, "x")
    assert apply_edits(source, respell(entry.value.span, "old", new)) == after


@pytest.mark.parametrize(
    ("text", "after"),
    [
        ("a: {x: -2}\n", "a: {x: -2.0}\n"),
        ("x: -2  # so\n", "x: -2.0  # so\n"),
        ("x: -0o2\n", "x: -0o2\n"),
        ('x: "-2"\n', 'x: "-2"\n'),
    ],
)
def test_an_end_is_added_after_plain_text(text: str, after: str) -> None:
    source, _, entry = entry_of(text, "x")
    assert apply_edits(source, append_to(entry.value.span, "-2", ".0")) == after


def test_edits_of_one_stretch_contradict_each_other() -> None:
    source = SourceFile.of("f", "abc\n")
    edits = [Edit(Span.at(source, 1, 1, 2), "x"), Edit(Span.at(source, 1, 2, 1), "y")]
    with pytest.raises(ValueError, match="f:1:2: overlapping edits"):
        apply_edits(source, edits)


def test_text_removed_by_two_edits_is_removed_once() -> None:
    source = SourceFile.of("f", "abcd\n")
    edits = [Edit(Span.at(source, 1, 1, 2), ""), Edit(Span.at(source, 1, 2, 2), "")]
    assert apply_edits(source, [*edits, *edits]) == "d\n"
