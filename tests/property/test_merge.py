"""Properties of merging any two files: the outer file wins, and locations are kept."""

from collections.abc import Iterator

from hypothesis import given
from hypothesis import strategies as st

from obk_cli.config.loader import merge_trees
from obk_cli.config.tree import Tree, TreeList, TreeMap, TreeScalar, plain_value
from obk_cli.config.yaml_parser import parse_source
from obk_cli.diagnostics.source import SourceFile, Span

KEYS = st.sampled_from(("name", "key", "ros_parameter", "topic", "id", "a", "b", "pub_x_setting"))
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(0, 3) | st.sampled_from(("x", "y", "pub_x", "")),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3),
    max_leaves=12,
)
MAPS = st.dictionaries(KEYS, VALUES, max_size=4)


def tree_of(value: object, path: str) -> Tree:
    """Flow style: Python's own notation except for null."""
    text = repr(value).replace("None", "~").replace("True", "true").replace("False", "false")
    tree = parse_source(SourceFile.of(path, text)).tree
    assert tree is not None
    return tree


def spans(tree: Tree) -> Iterator[Span]:
    yield tree.span
    for entry in tree if isinstance(tree, TreeMap) else ():
        yield entry.key_span
        yield from spans(entry.value)
    for item in tree.items if isinstance(tree, TreeList) else ():
        yield from spans(item)


@given(MAPS, MAPS)
def test_the_outer_text_wins_and_other_values_are_kept(
    inner: dict[str, object], outer: dict[str, object]
) -> None:
    merged = merge_trees(tree_of(inner, "inner"), tree_of(outer, "outer"))
    assert isinstance(merged, TreeMap)
    reported = plain_value(merged)
    assert isinstance(reported, dict)
    for key in {*inner, *outer}:
        if key not in outer:
            assert reported[key] == inner[key]
        elif outer[key] is None and key in inner:
            assert key not in reported
        elif not isinstance(outer[key], list | dict):
            assert reported[key] == outer[key]
    known = {*spans(tree_of(inner, "inner")), *spans(tree_of(outer, "outer"))}
    assert {*spans(merged)} <= known


@given(MAPS)
def test_a_text_over_nothing_and_nothing_over_a_text_are_the_text(value: dict[str, object]) -> None:
    nothing, tree = tree_of({}, "nothing"), tree_of(value, "text")
    assert plain_value(merge_trees(nothing, tree)) == plain_value(tree)
    assert plain_value(merge_trees(tree, nothing)) == plain_value(tree)


@given(VALUES, VALUES)
def test_a_single_value_is_replaced_by_any_outer_value(inner: object, outer: object) -> None:
    below, above = tree_of(inner, "inner"), tree_of(outer, "outer")
    if isinstance(below, TreeScalar) or isinstance(above, TreeScalar):
        assert merge_trees(below, above) == above
